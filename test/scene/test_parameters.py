"""The parameter table: complete and fit for its readers."""

import pytest

from dlo_sim.scene.description import markdown_table, placeholder_parameters, scene_parameters
from dlo_sim.scene.parameter import Parameter, check_value

TABLE = scene_parameters(("tip",), ("hand",), ("table",), ("a",), ("c",), ("plug",))


def test_no_key_is_there_twice():
    keys = [row.key for row in TABLE]
    assert len(keys) == len(set(keys))


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.key)
def test_every_parameter_has_a_complete_row(row):
    assert row.description.endswith("."), "a sentence for people"
    assert check_value(row, row.default) == row.default, "the default passes its own check"
    if row.element_kind in ("double", "integer"):
        assert row.low is not None and row.high is not None and row.low < row.high
    if row.kind == "double":
        assert isinstance(row.default, float)
    if row.choices:
        assert row.default in row.choices


def test_types_of_fields_are_kinds_of_rows():
    kinds = {row.key: (row.kind, row.length) for row in TABLE}
    assert kinds["cable.length"] == ("double", None)
    assert kinds["discretization.samples"] == ("integer", None)
    assert kinds["end.clamped"] == ("bool", None)
    assert kinds["cable.rest_curvature"] == ("double_array", None)
    assert kinds["loads.tip.torque"] == ("double_array", 3)
    assert kinds["start.fixed"] == ("bool_array", 3)
    assert kinds["loads.names"] == ("string_array", None)
    assert kinds["loads.tip.topic"] == ("string", None)


def test_ends_differ_in_where_and_whether_they_are_held():
    rows = {row.key: row.default for row in TABLE}
    fields = [key.partition(".")[2] for key in rows if key.startswith("start.")]
    different = {name for name in fields if rows[f"start.{name}"] != rows[f"end.{name}"]}
    assert different == {"position", "fixed"}
    assert (rows["start.position"], rows["end.position"]) == ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert (rows["start.fixed"], rows["end.fixed"]) == ((True,) * 3, (False,) * 3)


def load_rows(name: str) -> dict[str, Parameter]:
    """The rows of a load by the last part of their keys."""
    rows = scene_parameters((name,))
    return {row.key.split(".")[-1]: row for row in rows if row.key.startswith(f"loads.{name}.")}


def test_only_the_default_position_of_a_load_depends_on_its_name():
    start, other = load_rows("start"), load_rows("tip")
    different = {name for name in other if start[name].default != other[name].default}
    assert different == {"position"}
    assert (start["position"].default, other["position"].default) == (0.0, 1.0)


def test_markdown_has_one_row_per_parameter_and_whole_cells():
    lines = markdown_table().splitlines()
    keys = [row.key for row in placeholder_parameters()]
    inner = {".".join(key.split(".")[:3]) for key in keys if key.count(".") > 2}
    alike = [part for part in inner if not part.endswith(".discretization")]  # one row each
    assert len(alike) == 5
    once = [key for key in keys if not any(key.startswith(f"{part}.") for part in alike)]
    assert len(lines) == 2 + len(once) + len(alike)
    assert all(line.count("|") == 7 for line in lines)
    assert any(line.startswith("| `branches.<name>.cable.*` |  |") for line in lines)
    length = "| `cable.length` | double | `1.0` | m | 0.0001 to 10000 | Rest length L"
    assert any(line.startswith(length) for line in lines)
    assert any(line.startswith("| `loads.<name>.force` | double[3] |") for line in lines)
