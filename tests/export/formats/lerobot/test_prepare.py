"""Processes of an export end with the one that started them."""

import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import Connection

from pipeline.export.formats.lerobot.videos import start_worker


def open_pool(found: Connection) -> None:
    """Tell the number of a worker that is idle, and wait to be killed."""
    with ProcessPoolExecutor(2, multiprocessing.get_context("fork"), start_worker) as pool:
        found.send([pool.submit(os.getpid).result(), pool.submit(os.getpid).result()])
        time.sleep(60)


def alive(process: int) -> bool:
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_workers_of_a_killed_export_end():
    here, there = multiprocessing.Pipe()
    context = multiprocessing.get_context("spawn")
    process = context.Process(target=open_pool, args=(there,))
    process.start()
    workers = set(here.recv())
    assert all(map(alive, workers))
    process.kill()
    process.join()
    until = time.monotonic() + 10
    while any(map(alive, workers)) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(map(alive, workers))
