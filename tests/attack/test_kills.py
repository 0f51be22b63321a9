"""A few of the kills and corruptions of `make kills`, and a soak of seconds."""

import random

import gramian as gm
from attack.kills import CHUNK, SEED, TRIALS, corruptions, kills
from attack.soak import resident
from monte_carlo_cases import Level, mean


def bits():
    found = gm.monte_carlo.run(Level(10), TRIALS, SEED, mean, table=True, chunk=CHUNK)
    return found.table.tobytes()


def test_corruptions_cost_no_bit(tmp_path):
    _, wrong = corruptions(20, random.Random(1), bits(), tmp_path)
    assert not wrong


def test_kills_cost_no_bit(tmp_path):
    hit, wrong = kills(3, random.Random(1), bits(), tmp_path)
    assert hit == 3
    assert wrong == 0


def test_answers_leave_no_memory_behind():
    def work(times):
        for seed in range(times):
            problem = gm.Problem([[1.0, float(seed)], [1.0, 2.0]], ["a", "b"])
            gm.analyze(problem).summary()
            gm.monte_carlo.normals(seed, 0, 100, 100)

    work(300)
    before = resident()
    work(3000)
    # One kilobyte a round would be three of these.
    assert resident() - before < 1.0
