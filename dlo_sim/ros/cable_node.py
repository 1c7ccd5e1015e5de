"""A node with a cable, which begins at once and lives as long as the node."""

from dlo_sim.ros.guarded_node import GuardedNode
from dlo_sim.ros.live_cable import LiveCable


class CableNode(GuardedNode):
    """A node with a cable.

    Attributes:
        cable: None before the start and after the end.
    """

    cable: LiveCable | None = None

    @property
    def failure(self) -> str | None:
        """Why the cable must end, one line; None while all is well."""
        return None if self.cable is None else self.cable.failure

    def start(self) -> None:
        """Predict from now on, with an executor that spins the node.

        Raises:
            SceneError: the scene is refused.
        """
        self.cable = LiveCable(self)
        self.cable.activate()

    def end(self) -> None:
        """Say goodbye: keep the state, remove the markers from every viewer."""
        if self.cable is not None:
            self.cable.close()
            self.cable = None
