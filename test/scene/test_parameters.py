"""The parameter table: complete, consistent with the dataclasses, and fit for its readers."""

import dataclasses

import pytest

from dlo_sim.scene import description
from dlo_sim.scene.checking import check_value
from dlo_sim.scene.parameters import (
    PARAMETERS,
    load_parameters,
    markdown_table,
    scene_parameters,
)

TABLE = scene_parameters(("tip",))


def described_keys() -> set[str]:
    """The keys that the dataclasses describe: attribute paths."""
    keys = {"loads.names"}
    for field in dataclasses.fields(description.Scene):
        if field.name == "loads":
            members = dataclasses.fields(description.Load)
            keys |= {f"loads.tip.{member.name}" for member in members if member.name != "name"}
        elif dataclasses.is_dataclass(field.type):
            keys |= {f"{field.name}.{member.name}" for member in dataclasses.fields(field.type)}
        else:
            keys.add(field.name)
    return keys


def test_table_and_dataclasses_name_the_same_keys():
    assert {row.key for row in TABLE} == described_keys()


def test_no_key_is_there_twice():
    keys = [row.key for row in TABLE]
    assert len(keys) == len(set(keys))


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.key)
def test_row_is_complete(row):
    assert row.description.endswith("."), "a sentence for people"
    assert check_value(row, row.default) == row.default, "the default passes its own check"
    if row.element_kind in ("double", "integer"):
        assert row.low is not None and row.high is not None and row.low < row.high
    if row.kind == "double":
        assert isinstance(row.default, float)
    if row.choices:
        assert row.default in row.choices


@pytest.mark.parametrize(
    "row", [row for row in TABLE if row.key != "loads.names"], ids=lambda row: row.key
)
def test_fields_have_the_kind_of_the_row(row):
    parts = row.key.split(".")
    group = {"loads": "Load", "start": "End", "end": "End"}.get(parts[0], parts[0].capitalize())
    owner = getattr(description, group) if len(parts) > 1 else description.Scene
    field = next(f for f in dataclasses.fields(owner) if f.name == parts[-1])
    scalars = {"double": float, "integer": int, "bool": bool, "string": str}
    if row.is_array:
        one = scalars[row.element_kind]
        assert field.type == (tuple[(one,) * row.length] if row.length else tuple[one, ...])
    else:
        assert field.type is scalars[row.kind]


def test_only_the_default_position_of_a_load_depends_on_its_name():
    start = {row.key.split(".")[-1]: row for row in load_parameters("start")}
    other = {row.key.split(".")[-1]: row for row in load_parameters("tip")}
    different = {name for name in other if start[name].default != other[name].default}
    assert different == {"position"}
    assert (start["position"].default, other["position"].default) == (0.0, 1.0)


def test_markdown_has_one_row_per_parameter_and_whole_cells():
    lines = markdown_table().splitlines()
    assert len(lines) == 2 + len(PARAMETERS) + len(load_parameters("tip"))
    assert all(line.count("|") == 7 for line in lines)
    assert "| `cable.length` | double | `1.0` | m | 0.0001 to 10000 | Rest length L. |" in lines
    assert any(line.startswith("| `loads.<name>.force` | double[3] |") for line in lines)
