"""Bootstrap and validation on any executor: the same bits, the same files, and what cannot be sent."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import famjax
from fitting import Identification, InputError, identify, load_bundled
from fitting.evidence import Bootstrap, Validation, bootstrap, validate

EXAMPLES = Path(__file__).parents[3] / "examples"
REPLICATES = 520  # three chunks, the last one short


@pytest.fixture(scope="module")
def here(fitted20: Identification) -> Bootstrap:
    return bootstrap(fitted20, REPLICATES, seed=3)


def same(one: Bootstrap, other: Bootstrap) -> bool:
    return (
        one.names == other.names
        and one.failed == other.failed
        and np.array_equal(one.samples, other.samples)
        and np.array_equal(one.forces, other.forces)
    )


def same_refits(one: Validation, other: Validation) -> bool:
    values, others = vars(one.refits), vars(other.refits)
    return all(np.array_equal(values[name], others[name]) for name in values)


@pytest.mark.slow
def test_a_bootstrap_that_is_sent_has_the_same_bits(
    fitted20: Identification, here: Bootstrap, sent: Any
) -> None:
    told = []
    again = bootstrap(
        fitted20, REPLICATES, seed=3, executor=sent, progress=lambda *of: told.append(of)
    )
    assert sent.count == 3
    assert same(here, again)
    assert told == [(done, REPLICATES) for done in (0, 250, 500, REPLICATES)]
    with ThreadPoolExecutor(1) as one:
        assert same(here, bootstrap(fitted20, REPLICATES, seed=3, executor=one))


@pytest.mark.slow
def test_whole_lengths_that_are_sent_have_the_same_bits(
    fitted20: Identification, sent: Any
) -> None:
    own: dict[str, Any] = {"resample": "length", "replicates": 260}
    assert same(bootstrap(fitted20, **own), bootstrap(fitted20, **own, executor=sent))
    assert sent.count == 2
    bootstrap(fitted20, 250, executor=sent)
    assert sent.count == 2  # one chunk is done here


def test_more_replicates_begin_with_the_same(fitted20: Identification, here: Bootstrap) -> None:
    fewer = bootstrap(fitted20, 250, seed=3)
    assert not fewer.failed
    np.testing.assert_array_equal(fewer.samples, here.samples[:250])


@pytest.mark.slow
def test_a_stopped_bootstrap_goes_on_to_the_same_bytes(
    fitted20: Identification, here: Bootstrap, tmp_path: Path, sent: Any
) -> None:
    whole, cut = tmp_path / "whole.jsonl", tmp_path / "cut.jsonl"
    assert same(here, bootstrap(fitted20, REPLICATES, seed=3, resume=whole))

    class StoppedError(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done == 500:
            raise StoppedError

    with pytest.raises(StoppedError):
        bootstrap(fitted20, REPLICATES, seed=3, resume=cut, progress=stop)
    assert len(cut.read_bytes().splitlines()) == 3  # the settings and two parts
    assert same(here, bootstrap(fitted20, REPLICATES, seed=3, resume=cut, executor=sent))
    assert sent.count == 1
    assert cut.read_bytes() == whole.read_bytes()
    with pytest.raises(InputError, match=r"a bootstrap of other data .*seed"):
        bootstrap(fitted20, REPLICATES, seed=4, resume=cut)


def test_a_validation_that_is_sent_has_the_same_bits(fitted20: Identification, sent: Any) -> None:
    told = []
    here = validate(fitted20, "pressure")
    again = validate(fitted20, "pressure", executor=sent, progress=lambda *of: told.append(of))
    assert sent.count == 2  # of twenty pressures
    assert same_refits(here, again)
    assert here.rmse == again.rmse
    assert told == [(0, 20), (16, 20), (20, 20)]
    validate(fitted20, "length", executor=sent)
    assert sent.count == 2  # one task is done here


@pytest.mark.slow
def test_what_cannot_be_sent_is_done_here_and_said(sent: Any) -> None:
    class Longer(famjax.geometries.EndEffectGeometry):
        """A class within a function, which no other process can import."""

    data = load_bundled("DMSP-10-250")
    fit = identify(data, geometry=lambda shape: Longer(shape, 1.0), starts=2)
    with pytest.warns(UserWarning, match="done in this process: put that in a module"):
        again = bootstrap(fit, 260, executor=sent)
    assert not sent.count
    assert same(bootstrap(fit, 260), again)


@pytest.mark.slow
def test_a_law_typed_at_a_prompt_is_fitted_here_and_said() -> None:
    law, _, _ = (EXAMPLES / "own_law.py").read_text().partition("if __name__")
    typed = """
import jax
jax.config.update("jax_enable_x64", True)
import fitting
result = fitting.identify(fitting.load_bundled("DMSP-10-250"), law=Gent, starts=2)
print(fitting.bootstrap(result, 260, executor=2))
"""
    done = subprocess.run(
        [sys.executable, "-c", law + typed], capture_output=True, text=True, check=True
    )
    assert "a class typed at a prompt, so it is done in this process" in done.stderr
    assert "Bootstrap(" in done.stdout


@pytest.mark.slow
def test_two_processes_find_the_same_bits(fitted20: Identification, here: Bootstrap) -> None:
    assert same(here, bootstrap(fitted20, REPLICATES, seed=3, executor=2))
    here_validated = validate(fitted20, "pressure")
    assert same_refits(here_validated, validate(fitted20, "pressure", executor=2))
