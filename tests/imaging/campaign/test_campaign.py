"""Campaigns: stopped, killed, resumed, with pictures that fail."""

import dataclasses
import os
import signal
import warnings
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from processes import python
from rendering import published_scene, render

import imaging.campaign
import imaging.measurement
from imaging import Recipe, Scale, measure, process
from imaging.errors import MixedSizes, NoMuscle

RECIPE = Recipe(Scale.manual(8922.0, 0.1), distance=1.524)
SMALL = (500, 220)


Figures = dataclasses.make_dataclass("Figures", ["blur_px"])


def fake_measurement(length):
    """What a measurement of a straight muscle would be."""
    z = np.linspace(0, length, 50)
    return SimpleNamespace(
        z=z, diameter=np.full(50, 0.03), diameter_stderr=np.full(50, 1e-5), length=length,
        length_stderr=1e-5, mean_diameter=0.03, mean_diameter_stderr=1e-5,
        volume=7e-4 * length, volume_stderr=1e-9, px_per_m=8922.0, roll=0.0, x0=0.0,
        distance=1.524, distance_stderr=0.0, tilt=0.0, bow=0.0, warnings=(), braid=None,
        quality=Figures(1.0),
    )  # fmt: skip


class Serial(Executor):
    """Everything in turn, in this process."""

    _max_workers = 1

    def submit(self, fn, /, *args, **options):
        done = Future()
        done.set_result(fn(*args, **options))
        return done


@pytest.fixture
def photos(tmp_path, monkeypatch):
    """Twenty files that a fake `measure` reads: a length, or what is wrong. And what it has read."""
    seen = []

    def measure(path, recipe):
        seen.append(path)
        text = Path(path).read_text()
        if "cloth" in text:
            raise NoMuscle("nothing stands out", path=path, eta_value=0.2)
        return fake_measurement(float(text))

    monkeypatch.setattr(imaging.measurement, "measure", measure)
    folder = tmp_path / "photos"
    folder.mkdir()
    paths = [folder / f"img{k:02d}.jpg" for k in range(20)]
    for k, path in enumerate(paths):
        path.write_text("cloth" if k == 5 else str(0.23 - 0.001 * k))
    return SimpleNamespace(paths=paths, seen=seen, output=tmp_path / "out")


def test_the_rows_stand_in_the_order_of_the_paths_and_a_failure_is_a_row(photos):
    table = process([*photos.paths[::-1], photos.paths[3]], RECIPE, executor=Serial())
    assert list(table.path) == [str(path) for path in photos.paths[::-1]]
    good = [k for k in range(20) if k != 14]
    np.testing.assert_allclose(table["length"][good], [0.23 - 0.001 * (19 - k) for k in good])
    assert table.error[14] == "NoMuscle: nothing stands out [eta_value = 0.2]"
    assert np.isnan(table["length"][14])
    assert np.isnan(table.diameter[14]).all()
    assert table.ok.sum() == 19
    assert table["contraction"][0] == pytest.approx(0.019 / 0.23)


@pytest.mark.parametrize("executor", [Serial, lambda: ThreadPoolExecutor(3)])
def test_any_executor_gives_the_same_table(photos, executor):
    with executor() as one:
        table = process(photos.paths, RECIPE, executor=one)
    reference = process(photos.paths, RECIPE, executor=Serial())
    assert table.csv_text() == reference.csv_text()
    np.testing.assert_array_equal(table.diameter, reference.diameter)


def test_a_stopped_campaign_goes_on_where_it_was(photos):
    def stop(done, total):
        if done >= 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process(photos.paths, RECIPE, photos.output, Serial(), progress=stop)
    photos.seen.clear()
    table = process(photos.paths, RECIPE, photos.output, Serial())
    assert photos.seen == [str(path) for path in photos.paths[8:]]
    assert table.csv_text() == process(photos.paths, RECIPE, executor=Serial()).csv_text()


KILLED = """
import os, signal, sys
sys.path.insert(0, {tests!r})
import test_campaign as t, imaging.measurement, imaging.campaign
from imaging import process
left = [{after}]
def measure(path, recipe):
    left[0] -= 1
    if left[0] < 0 and {where!r} == "measure":
        os.kill(os.getpid(), signal.SIGKILL)
    return t.fake_measurement(float(open(path).read()))
def fsync(file, real=os.fsync):
    if left[0] <= 0 and {where!r} == "write":
        os.truncate(file, os.fstat(file).st_size - 100)
        os.kill(os.getpid(), signal.SIGKILL)
    real(file)
imaging.measurement.measure = measure
imaging.campaign.os.fsync = fsync
process(sys.argv[2:], t.RECIPE, sys.argv[1], t.Serial())
"""


@pytest.mark.skipif(os.name != "posix", reason="kill -9 is POSIX")
@pytest.mark.parametrize(("where", "kept"), [("measure", 7), ("write", 6)])
def test_kill_minus_9_loses_no_picture_and_repeats_none_that_was_kept(photos, where, kept):
    photos.paths[5].write_text("0.2")
    script = KILLED.format(tests=str(Path(__file__).parent), after=7, where=where)
    names = [str(path) for path in photos.paths]
    root = Path(imaging.__file__).parents[1]
    path = os.pathsep.join([str(root), str(root / "tests")])
    run = python("-c", script, photos.output, *names, env=os.environ | {"PYTHONPATH": path})
    assert run.returncode == -signal.SIGKILL, run.stderr
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        table = process(names, RECIPE, photos.output, Serial())
    assert ["damaged" in str(one.message) for one in told] == [True] * (where == "write")
    assert photos.seen == names[kept:]
    assert list(table.path) == names
    np.testing.assert_allclose(table["length"], [float(Path(n).read_text()) for n in names])


def test_other_pictures_or_another_recipe_are_measured_again_and_touched_ones_are_not(photos):
    process(photos.paths, RECIPE, photos.output, Serial())
    os.utime(photos.paths[1], (1, 1))
    photos.seen.clear()
    process(photos.paths, RECIPE, photos.output, Serial())
    assert not photos.seen
    photos.paths[2].write_text("0.111")
    table = process(photos.paths, RECIPE, photos.output, Serial())
    assert table["length"][2] == 0.111
    photos.seen.clear()
    process(photos.paths, dataclasses.replace(RECIPE, distance=2.0), photos.output, Serial())
    assert len(photos.seen) == 20


def test_mixed_sizes_are_refused_before_any_work(tmp_path, photos):
    paths = []
    for k, size in enumerate([(60, 40), (60, 40), (40, 60)]):
        paths.append(tmp_path / f"{k}.png")
        Image.new("RGB", size).save(paths[-1])
    with pytest.raises(MixedSizes, match=r"2 are 60 x 40 px, unlike .*2.png \(40 x 60\)"):
        process(paths, RECIPE, executor=Serial())
    assert photos.seen == []


@pytest.mark.slow
def test_spawned_workers_measure_as_this_process_does(tmp_path):
    """Four small pictures of a stroke, and one of them cut short."""
    photos = [render(published_scene(k / 10, size=SMALL), seed=k) for k in range(4)]
    paths = [photo.save(tmp_path / f"img{k}.jpg") for k, photo in enumerate(photos)]
    paths.append(tmp_path / "img4.jpg")
    paths[4].write_bytes(paths[0].read_bytes()[:20_000])
    px_per_m = photos[0].truth.px_per_m
    recipe = Recipe(Scale.manual(px_per_m, 1e-5 * px_per_m))
    table = process(paths, recipe, executor=2)
    assert [bool(ok) for ok in table.ok] == [True, True, True, True, False]
    assert table.error[4].startswith("UnreadableImage")
    for k in range(4):
        # 43 px/in here: a tenth of a pixel is 0.0023 in, for each of two tapes.
        assert abs(table["length"][k] - photos[k].truth.length) < 0.006 * 0.0254
        found = measure(paths[k], recipe)
        expected = np.interp(imaging.campaign.POSITION * found.length, found.z, found.diameter)
        np.testing.assert_allclose(table.diameter[k], expected, rtol=1e-12)
        assert table["volume_stderr"][k] == found.volume_stderr
