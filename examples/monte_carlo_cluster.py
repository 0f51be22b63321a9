"""A Monte Carlo run on a Dask cluster: the same numbers as on one core, to the last bit.

    python examples/monte_carlo_cluster.py [scheduler address] [trials]

Without an address a cluster of two worker processes is started on this machine.
With one ("tcp://host:8786") the work goes to as many machines as its scheduler has.
"""

import sys

import numpy as np
from distributed import Client, LocalCluster

import gramian as gm


def scene():
    """A ship that turns once while it takes bearings of another."""
    times = np.arange(60) * 10.0
    east = np.where(times < 300, 0, 5 * (times - 300))
    north = np.minimum(5 * times, 1500)
    path = np.stack([east, north], axis=1)
    return gm.monte_carlo.Bearings(times, path, [2000.0, 5000.0, -2.0, 1.0], np.radians(0.1))


def main():
    address = sys.argv[1] if len(sys.argv) > 1 else None
    trials = int(sys.argv[2]) if len(sys.argv) > 2 else 100_000
    cluster = address or LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with Client(cluster) as client:
        # A worker that dies loses nothing; with resume, neither does this process.
        spread = gm.monte_carlo.run(
            scene(), trials, seed=1, executor=client.get_executor(), resume="out/cluster-run"
        )
    print(spread.summary())
    alone = gm.monte_carlo.run(scene(), trials, seed=1)
    print("the same as on this machine alone:", alone.to_dict() == spread.to_dict())


if __name__ == "__main__":
    main()
