"""Keys and values that scenes once had, and what becomes of them: they are read, with one line."""

import warnings
from collections.abc import Mapping

IGNORED = "is ignored; remove it"
# Key, or key and value -> what is said, and the values in its place.
RETIRED: dict[str | tuple[str, str], tuple[str, dict[str, object]]] = {
    "integrator.zhai_psi": (f"{IGNORED}: zhai has psi = phi = 0.5, of the largest step", {}),
    "integrator.zhai_phi": (f"{IGNORED}: zhai has psi = phi = 0.5, of the largest step", {}),
    ("discretization.mass", "selective"): (f"{IGNORED}: the mass is consistent", {}),
    ("terms.twist", "on"): (
        "means quasistatic; give that, or auto",
        {"terms.twist": "quasistatic"},
    ),
    ("integrator.method", "rattle"): (
        "means energy_momentum with terms.stretch off; give these",
        {"integrator.method": "energy_momentum", "terms.stretch": "off"},
    ),
}


RENAMED = {"contact.self": "contact.self_contact"}


def without_retired(values: Mapping[str, object]) -> dict[str, object]:
    """The values without keys and values that are retired, each with a UserWarning of one line."""
    kept = dict(values)
    for key, value in values.items():
        # YAML 1.1 readers, ROS among them, read an unquoted on/off as a boolean.
        word = ("off", "on")[value] if isinstance(value, bool) else value
        pair = (key, word) if isinstance(word, str) else key
        said, instead = RETIRED.get(key) or RETIRED.get(pair) or ("", {})
        if key in RENAMED:
            said, instead = f"is now {RENAMED[key]}; rename the key", {RENAMED[key]: value}
        if said:
            kept.pop(key)
            kept = instead | kept  # what a scene says beside it counts
            warnings.warn(f"{key}: {word} {said}", stacklevel=4)
    return kept
