"""Messages of markers that are obstacles."""

from dlo_sim.session import cdr

FLAT = (0.0, 0.0, 0.0, 1.0)


def marker(  # type: ignore[no-untyped-def]
    number,
    position,
    scale,
    kind=cdr.CUBE,
    *,
    action=cdr.ADD,
    turn=FLAT,
    frame="world",
    ns="cell",
    lifetime=0.0,
    points=(),
):
    """A marker without a stamp; `lifetime` [s], `points` of triangles."""
    made = cdr.new(cdr.MARKER, ns=ns, id=number, type=kind, action=action)
    made.header.frame_id = frame
    for field, values in (("position", position), ("orientation", turn)):
        for axis, value in zip("xyzw", values, strict=False):
            setattr(getattr(made.pose, field), axis, value)
    made.points = [cdr.new("geometry_msgs/msg/Point", x=x, y=y, z=z) for x, y, z in points]
    made.scale.x, made.scale.y, made.scale.z = scale
    made.lifetime.sec, made.lifetime.nanosec = int(lifetime), round(lifetime % 1.0 * 1e9)
    return made


def array(stamp_ns, *markers):  # type: ignore[no-untyped-def]
    """A serialised MarkerArray with this stamp [ns]."""
    for one in markers:
        one.header.stamp.sec, one.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return cdr.write(cdr.MARKER_ARRAY, cdr.new(cdr.MARKER_ARRAY, markers=list(markers)))
