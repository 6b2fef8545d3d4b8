"""One policy for many episodes: its answers are those of one episode at a time, whatever arrives
when."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from pipeline.evaluate.episode import EpisodeJob, run_episode
from pipeline.evaluate.names import make_policy, policy_name
from pipeline.evaluate.policies.policy import BatchPolicy, Observation, PolicyError
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.serving.batching import Batcher, batcher_of
from tests.evaluate.environment.test_env import case_of
from tests.evaluate.serving.servers import START, Echo, serving

SOURCE = '''
import numpy as np
from pipeline.evaluate.policies.policy import BatchPolicy


class Episode:
    def __init__(self, start):
        self.rng, self.inferences, self.left = np.random.default_rng(start.seed), 0, 0


class Wanders(BatchPolicy):
    """Answers from what each episode remembers: noise of its own, and a network that runs at every second question."""

    def begin(self, start):
        return Episode(start)

    def act_together(self, asked):
        out = []
        for episode, seen in asked:
            episode.inferences += episode.left == 0
            episode.left = 1 - episode.left
            meanwhile = 0.0 if not len(seen.committed) else seen.committed.sum()
            out.append(seen.joints + 0.02 * episode.rng.normal(size=(3, len(seen.joints))) + 1e-3 * meanwhile)
        return out


def make_policy():
    return Wanders()
'''  # noqa: E501


class Counts(BatchPolicy):
    """Answers with the number of the question in its episode; fails for a negative time; keeps the
    sizes of its batches."""

    def __init__(self, gate=None):
        self.sizes, self.gate = [], gate

    def begin(self, start):
        return {"seed": start.seed, "asked": 0}

    def act_together(self, asked):
        self.sizes.append(len(asked))
        if self.gate is not None:
            self.gate.wait(10)
        if any(seen.time < 0 for _, seen in asked):
            raise KeyError("no such time")
        for episode, _ in asked:
            episode["asked"] += 1
        return [
            1000.0 * episode["seed"] + episode["asked"] + seen.joints for episode, seen in asked
        ]


def look(time=0.0):
    return Observation(np.zeros(7), "press", time)


def first(policy, time=0.0):
    return float(np.asarray(policy.act(look(time)))[0])


def in_threads(*works):
    threads = [threading.Thread(target=work) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
        assert not thread.is_alive()


@pytest.mark.parametrize(("clients", "most"), [(1, 64), (3, 2), (5, 64)])
def test_every_episode_gets_its_own_answers_whatever_the_batches(clients, most):
    policy = Counts()
    batcher, found = Batcher(policy, 0.05, most), {}

    def play(seed):
        seat, rows = batcher.seat(), []
        for _ in range(2):
            seat.reset(replace(START, seed=seed))
            rows += [first(seat) for _ in range(4)]
        seat.leave()
        found[seed] = rows

    in_threads(*(lambda seed=seed: play(seed) for seed in range(clients)))
    assert found == {seed: [1000.0 * seed + n for n in (1, 2, 3, 4)] * 2 for seed in range(clients)}
    assert sum(policy.sizes) == 8 * clients and max(policy.sizes) <= most


def test_questions_that_wait_are_answered_in_one_batch_and_a_bad_one_costs_only_its_own_episode():
    gate = threading.Event()
    policy = Counts(gate)
    batcher, found = Batcher(policy, 20.0), {}
    seats = [batcher.seat() for _ in range(3)]
    for seed, seat in enumerate(seats):
        seat.reset(replace(START, seed=seed))

    def ask(n, time):
        try:
            found[n] = first(seats[n], time)
        except KeyError as error:
            found[n] = str(error)

    gate.set()
    in_threads(lambda: ask(0, 0.0), lambda: ask(1, -1.0), lambda: ask(2, 0.0))
    assert found == {0: 1.0, 1: "'no such time'", 2: 2001.0}
    # all three were waited for, although the bound is 20 s; then each alone
    assert policy.sizes == [3, 1, 1, 1]


def test_the_wait_has_a_bound():
    batcher = Batcher(Counts(), 0.01)
    idle, seat = batcher.seat(), batcher.seat()
    for each in (idle, seat):
        each.reset(START)
    assert first(seat) == 7001.0


def test_a_policy_of_single_episodes_is_refused_in_one_line():
    with pytest.raises(PolicyError, match=r"waits\.py: is no BatchPolicy: leave out --batch-wait"):
        batcher_of(Echo(), "waits.py", 0.0)


def test_an_episode_in_batches_with_others_gives_the_numbers_of_one_alone(tmp_path):
    (tmp_path / "wanders.py").write_text(SOURCE)
    name = policy_name(str(tmp_path / "wanders.py"))
    here = replace(name, process="evaluator")
    batcher = batcher_of(make_policy(here), "wanders.py", 0.002)
    jobs = [
        EpisodeJob(case_of("click_bell"), here, parse_clock(clock))
        for clock in ("sim", "async:100:rtc")
    ]
    alone, over = [run_episode(job) for job in jobs], threading.Event()
    with serving(batcher.seat, clients=3) as port:
        shared = replace(name, text=f"ws://127.0.0.1:{port}", process="server")

        def disturb():
            policy = make_policy(shared)
            policy.reset(START)
            while not over.is_set():
                policy.act(
                    Observation(
                        np.zeros(7), "press", 0.0, {"head_camera": np.zeros((6, 8, 3), np.uint8)}
                    )
                )
            policy.close()

        others = [threading.Thread(target=disturb) for _ in range(2)]
        for other in others:
            other.start()
        together = [run_episode(replace(job, policy=shared)) for job in jobs]
        over.set()
        for other in others:
            other.join(20)
    for row in (*alone, *together):
        row.pop("seconds_spent")
        row.pop("process")
    assert together == alone and all(row["inferences"] < row["asked"] for row in alone)


def test_clients_of_a_server_share_one_policy():
    policy = Counts()
    batcher = Batcher(policy, 0.0)
    images = {"head_camera": np.zeros((6, 8, 3), np.uint8)}
    with serving(batcher.seat, clients=2) as port:
        for seed in (1, 2):
            client = make_policy(policy_name(f"ws://127.0.0.1:{port}"))
            client.reset(replace(START, seed=seed))
            answers = [
                np.asarray(client.act(Observation(np.zeros(7), "press", 0.0, images)))[0, 0]
                for _ in range(2)
            ]
            assert answers == [1000 * seed + 1, 1000 * seed + 2]
            client.close()
    assert policy.sizes == [1] * 4
