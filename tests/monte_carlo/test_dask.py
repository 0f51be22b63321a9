"""Past one machine: the same run on a Dask cluster, whose workers may be killed."""

import os
import signal
import time
import warnings

import pytest

import gramian as gm
from monte_carlo_cases import linear_estimate, scene, slow

distributed = pytest.importorskip("distributed")

TRIALS = 600


@pytest.fixture(scope="module")
def client():
    with (
        warnings.catch_warnings(),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


# Sockets of the cluster's event loop are closed late, by the garbage collector.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


def test_a_cluster_does_not_change_a_bit(client):
    wanted = gm.monte_carlo.run(scene(), TRIALS, 11, linear_estimate)
    found = gm.monte_carlo.run(
        scene(), TRIALS, 11, linear_estimate, executor=client.get_executor(), chunk=64
    )
    assert found.to_dict() == wanted.to_dict()
    line = gm.Problem([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]], ["level", "slope"])
    alone = gm.monte_carlo.run(line, 5000, 3)
    spread = gm.monte_carlo.run(line, 5000, 3, executor=client.get_executor())
    assert spread.to_dict() == alone.to_dict()


def test_lambdas_go_to_a_cluster(client):
    """Dask sends functions by value, so what is defined in a notebook runs too."""
    line = gm.Problem([[1.0], [1.0]], ["level"])
    estimator = lambda z: [z.mean()]  # noqa: E731
    wanted = gm.monte_carlo.run(line, 200, 3, estimator)
    found = gm.monte_carlo.run(line, 200, 3, estimator, executor=client.get_executor())
    assert found.to_dict() == wanted.to_dict()


def test_a_client_in_place_of_its_executor_is_named(client):
    with pytest.raises(gm.InputError, match=r"pass its get_executor\(\)"):
        gm.monte_carlo.run(scene(), 10, 11, linear_estimate, executor=client)
    executor = client.get_executor()
    executor.shutdown()
    with pytest.raises(gm.InputError, match="executor takes no work"):
        gm.monte_carlo.run(scene(), 10, 11, linear_estimate, executor=executor)


def test_a_killed_worker_loses_nothing(client, tmp_path):
    """A worker is killed when the first chunks are done."""
    wanted = gm.monte_carlo.run(scene(), TRIALS, 11, slow)
    processes = [worker["pid"] for worker in client.run(_identity).values()]
    from threading import Thread

    def kill():
        while not list(tmp_path.glob("chunk-*")):
            time.sleep(0.005)
        os.kill(processes[0], signal.SIGKILL)

    killer = Thread(target=kill)
    killer.start()
    found = gm.monte_carlo.run(
        scene(), TRIALS, 11, slow, executor=client.get_executor(), resume=tmp_path
    )
    killer.join()
    assert found.to_dict() == wanted.to_dict()
    assert found.simulated == TRIALS
    with pytest.raises(ProcessLookupError):
        os.kill(processes[0], 0)


def _identity():
    return {"pid": os.getpid()}
