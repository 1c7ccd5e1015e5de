"""A small scene and its bags."""

from __future__ import annotations

import pytest
from bag_files import TOPICS, VALUES, messages, write_bag

from dlo_sim.scene.loading import scene_from_values


@pytest.fixture
def scene():
    return scene_from_values(VALUES)


@pytest.fixture
def make_bag(tmp_path):
    """make_bag(messages=..., topics=..., storage=..., name=...) -> path."""

    def make(found=None, topics=TOPICS, storage="mcap", name="recorded"):
        return write_bag(tmp_path / name, messages() if found is None else found, topics, storage)

    return make


@pytest.fixture
def recorded():
    """The messages of the standard bag."""
    return messages()


@pytest.fixture
def long_recording():
    """Enough messages for many pages of a database."""
    return messages(8.0)
