"""What a session calls its node and its topics: the names that others see on the wire."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.node_blocks import NODE_NAME


def resolved(topic: str) -> str:
    """A topic as the node `dlo_sim` in the root namespace would name it."""
    if topic.startswith("~/"):
        return f"/{NODE_NAME}/{topic[2:]}"
    return topic if topic.startswith("/") else f"/{topic}"


class Naming(NamedTuple):
    """Names of a node and its topics; the defaults are those of a node that nothing renames.

    Attributes:
        node: full name of the node, namespace included.
        topic: name of a topic in the scene (`~/force`) -> name on the wire, remapped.
    """

    node: str = f"/{NODE_NAME}"
    topic: Callable[[str], str] = resolved

    def check(self, topics: Iterable[tuple[str, str]]) -> None:
        """Refuse topics in the scene (name and type) that share a name on the wire and no type.

        Raises:
            SceneError: naming both.
        """
        seen: dict[str, tuple[str, str]] = {}
        for topic, kind in topics:
            name = self.topic(topic)
            other, other_kind = seen.setdefault(name, (topic, kind))
            if kind != other_kind:
                raise SceneError(
                    f"{name}: stands for {other} ({other_kind}) and for {topic} ({kind}); "
                    "give one of them another name"
                )


DEFAULT_NAMING = Naming()
