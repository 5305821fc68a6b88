"""Run the same comparison on every installed executor, and check that the results are identical."""

import multiprocessing
import tempfile
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec

import jax

import fitting


def engines():
    yield "this process", None
    yield "two processes", 2
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        yield "concurrent.futures", pool
    if find_spec("loky"):
        yield "loky", __import__("loky").get_reusable_executor(2)
    if find_spec("distributed"):
        with __import__("distributed").Client(n_workers=2, dashboard_address=":0") as client:
            yield "dask", client


if __name__ == "__main__":  # worker processes import this file
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", tempfile.mkdtemp())  # shared by all workers
    data = fitting.load_bundled("DMSP-20-300")
    models = ("gaylord", "ferraresi_deadband", "hildebrandt")
    found = {}
    for name, engine in engines():
        found[name] = fitting.compare(data, models, executor=engine).as_dict()
    same = all(one == found["this process"] for one in found.values())
    print(f"{found['this process']['models'][0]}, the same on {', '.join(found)}: {same}")
