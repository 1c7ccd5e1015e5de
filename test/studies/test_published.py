"""The paper's numbers: a mistyped digit changes the sum of its column and of its row."""

import numpy as np

from dlo_sim.studies.paper import published


def test_sums_are_those_of_the_printed_columns_and_rows():
    """Added up from the paper's source, independently of the transcription."""
    sums = {
        "MATLAB_1": [2847.08, 4147.41, 13495.33],
        "MATLAB_2": [2965.96],
        "CPP_1": [1086.23, 2033.98],
        "CPP_2": [1228.91, 2308.30],
    }
    for name, expected in sums.items():
        found = [values.sum() for values in getattr(published, name).values()]
        assert np.round(found, 2).tolist() == expected, name
    rows = {
        "SWEEP_MATLAB_1": [6346.06, 7376.99, 8823.06, 10139.5, 11914.74, 16069.28],
        "SWEEP_MATLAB_2": [6330.16, 7576.8, 8789.18, 10044.77, 11838.23, 16008.9],
        "SWEEP_CPP_1": [2100.96, 2683.07, 3311.42, 3917.847, 4449.336, 6230.85],
        "SWEEP_CPP_2": [2100.11, 2673.8, 3266.35, 3864.93, 4442.52, 6196.73],
    }
    for name, expected in rows.items():
        assert np.round(getattr(published, name).sum(axis=1), 3).tolist() == expected, name
