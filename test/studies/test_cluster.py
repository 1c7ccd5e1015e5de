"""Studies on a Dask cluster: the numbers of this process, to the last bit."""

import dataclasses

import numpy as np
import pytest

from dlo_sim.batch.workers import HERE, open_workers
from dlo_sim.studies.paper import accuracy
from dlo_sim.studies.runs import each
from dlo_sim.studies.work_precision import cantilever, references

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster():
    """Workers of a local cluster of one process."""
    distributed = pytest.importorskip("distributed", reason="Dask (extra 'dask') is not installed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
        ) as local,
        open_workers(local.scheduler_address) as workers,
    ):
        yield workers


class Counting:
    """Workers that count what they are given."""

    def __init__(self, workers):
        self.count, self.given, self._workers = workers.count, 0, workers

    def map(self, function, items):
        self.given += len(items)
        return self._workers.map(function, items)


def same_but(left_out, one, other):
    """Whether two dataclasses have equal fields, but for some."""
    names = {field.name for field in dataclasses.fields(one)} - left_out
    assert type(one) is type(other) and names
    for name in names:
        assert repr(getattr(one, name)) == repr(getattr(other, name)), name
    return True


def test_references_are_the_same(cluster):
    case = cantilever().shortened(0.1, (9, 11))
    given = Counting(cluster)
    there = references([case], given)[case.name]
    here = references([case], HERE)[case.name]
    assert given.given == 4
    assert np.array_equal(there.points, here.points)
    assert len(here.points) == 101 and np.ptp(here.points[:, 0, 2]) > 0.01
    assert same_but({"run"}, there, here)
    assert same_but({"points", "first"}, there.run, here.run)  # first: a run time


def test_pieces_of_the_paper_are_the_same(cluster):
    sizes = [(9, 51, 0.02), (11, 101, 0.02)]
    there, here = (each(who, accuracy.track, sizes) for who in (cluster, HERE))
    assert here[sizes[0]].shape == (accuracy.INSTANTS, accuracy.POINTS, 3)
    assert not np.array_equal(here[sizes[0]], here[sizes[1]])
    assert all(np.array_equal(there[size], here[size]) for size in sizes)
