"""`--jobs` and `--dask`: what they give to the library, and what is refused."""

import sys
from pathlib import Path

import pytest

from famjax.__main__ import main
from famjax.boundary.errors import InputError
from famjax.boundary.tasks import run_tasks
from famjax.commands.options.engine import EngineOptions


def test_jobs_are_a_number_of_processes_and_nothing_is_what_the_command_says() -> None:
    with EngineOptions(jobs=3).executor() as executor:
        assert executor == 3
    for otherwise in (None, "auto"):
        with EngineOptions().executor(otherwise) as executor:
            assert executor is otherwise


@pytest.mark.timeout(60)
def test_a_cluster_is_found_by_its_address_or_its_file_and_left(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="dask comes with the extra 'cluster'")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0",
        protocol="tcp",
    ) as cluster:  # fmt: skip
        file = tmp_path / "scheduler.json"
        file.write_text(f'{{"address": "{cluster.scheduler_address}"}}')
        for given in (cluster.scheduler_address, str(file)):
            with EngineOptions(dask=given).executor() as client:
                assert list(run_tasks(str, range(3), executor=client)) == ["0", "1", "2"]
            assert client.status == "closed"


@pytest.mark.parametrize("address", ["nonsense", "foo://here:1"])
def test_an_address_of_nothing_is_refused(address: str) -> None:
    pytest.importorskip("distributed", reason="dask comes with the extra 'cluster'")
    with (
        pytest.raises(InputError, match=rf"no dask scheduler answers at {address} \(.+\): give"),
        EngineOptions(dask=address).executor(),
    ):
        pass


def test_dask_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match="distributed comes with the extra 'cluster'"),
        EngineOptions(dask="tcp://here:1").executor(),
    ):
        pass


@pytest.mark.parametrize("command", ["sweep", "compare", "measure", "characterise"])
def test_every_long_command_has_both_options(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main([command, "here", "--jobs", "0"])
    assert stopped.value.code == 2
    assert "--jobs" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([command, "--help"])
    text = capsys.readouterr().out
    assert "--jobs" in text
    assert "--dask" in text


def test_one_place_at_a_time() -> None:
    with (
        pytest.raises(InputError, match="--jobs for this machine or --dask for a cluster"),
        EngineOptions(jobs=2, dask="tcp://here:1").executor(),
    ):
        pass
