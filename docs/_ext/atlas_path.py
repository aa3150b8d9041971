"""The signal path of a model as a drawing, with the place marked where an effect acts."""

from __future__ import annotations

from html import escape

Place = tuple[float, float]

THRUSTER = {
    "command": (0, 0),
    "drive": (1, 0),
    "shaft": (2, 0),
    "∫": (3, 0),
    "load": (2.5, 1),
    "propeller": (4, 0),
    "thrust": (5, 0),
    "speed": (5, 1),
}
THRUSTER_ARROWS = ["command drive", "drive shaft", "shaft ∫", "∫ propeller", "propeller thrust"]
THRUSTER_ARROWS += ["∫ speed", "∫ load", "load shaft"]

SPEED_LOOP = {
    "command": (0, 0),
    "target": (1, 0),
    "loop": (2, 0),
    "∫": (3, 0),
    "propeller": (4, 0),
    "thrust": (5, 0),
    "speed": (5, 1),
}
SPEED_LOOP_ARROWS = ["command target", "target loop", "loop ∫", "∫ propeller", "propeller thrust"]
SPEED_LOOP_ARROWS += ["∫ speed", "∫ loop"]

HULL = {
    "surge_force": (3, 0),
    "sway_force": (3, 1),
    "yaw_moment": (3, 2),
    "surge_acceleration": (4, 0),
    "sway_acceleration": (4, 1),
    "yaw_acceleration": (4, 2),
    "surge": (5, 0),
    "sway": (5, 1),
    "yaw_rate": (5, 2),
    "surge_through_water": (4, 3),
    "sway_through_water": (4, 4),
}
HULL_ARROWS = ["surge_force surge_acceleration", "sway_force sway_acceleration"]
HULL_ARROWS += ["yaw_moment yaw_acceleration", "surge_acceleration surge"]
HULL_ARROWS += ["sway_acceleration sway", "yaw_acceleration yaw_rate"]

VESSEL = {
    "propeller_speed": (0, 0),
    "revolutions": (1, 0),
    "propulsion": (2, 0),
    "rudder_angle": (0, 1),
    "rudder": (1, 1),
    "steering": (2, 1),
    **HULL,
}
VESSEL_ARROWS = ["propeller_speed revolutions", "revolutions propulsion"]
VESSEL_ARROWS += ["rudder_angle rudder", "rudder steering", "propulsion surge_force"]
VESSEL_ARROWS += ["propulsion steering", "steering sway_force", "steering yaw_moment"]

TWIN = {"left_force": (0, 0), "right_force": (0, 1), "propulsion": (2, 0), **HULL}
TWIN_ARROWS = ["left_force propulsion", "right_force propulsion", "propulsion surge_force"]
TWIN_ARROWS += ["right_force yaw_moment"]

AXIS = {
    "thrust": (0, 0),
    "force": (1, 0),
    "∫": (2, 0),
    "velocity": (3, 0),
    "position": (4, 0),
    "hull": (1.5, 1),
}
AXIS_ARROWS = ["thrust force", "force ∫", "∫ velocity", "velocity position", "∫ hull", "hull force"]

PATHS: dict[str, tuple[dict[str, Place], list[str]]] = {
    "dft.Thruster()": (THRUSTER, THRUSTER_ARROWS),
    "dft.SpeedLoopThruster()": (SPEED_LOOP, SPEED_LOOP_ARROWS),
    "dft.Vessel()": (VESSEL, [*VESSEL_ARROWS, *HULL_ARROWS]),
    "dft.AxisVehicle()": (AXIS, AXIS_ARROWS),
    'dft.Vessel(drive="twin")': (TWIN, [*TWIN_ARROWS, *HULL_ARROWS]),
}
"""Where each port, input and output of a model is drawn, and the arrows between them."""

WIDTH, HEIGHT, ACROSS, DOWN = 134, 40, 164, 72
MARKED = "#D55E00"


def drawn(code: str, ports: tuple[str, ...], ends: set[str], texts: dict[str, str]) -> str:
    """An SVG of a model's path; it takes its colours from the page, dark or light.

    Args:
        code: how the model is made.
        ports: where the effect acts; those that the drawing has are marked.
        ends: the inputs and outputs, which are drawn with round ends.
        texts: what each port carries, for the tip under the pointer.
    """
    places, arrows = PATHS[code]
    right = int(max(x for x, _ in places.values()) * ACROSS + WIDTH + 24)
    bottom = int(max(y for _, y in places.values()) * DOWN + HEIGHT + 8)
    named = ", ".join(ports)
    parts = [
        f'<svg class="signal-path" role="img" viewBox="-4 -4 {right} {bottom}" '
        f'xmlns="http://www.w3.org/2000/svg" '
        f'style="width:100%;min-width:640px;max-width:{right}px" '
        f'fill="none" stroke="currentColor" font-family="sans-serif" font-size="11">',
        f"<title>Signal path of {escape(code)}; the effect acts at {escape(named)}</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto-start-reverse"><path d="M0 0 8 4 0 8z" '
        'fill="currentColor" stroke="none"/></marker></defs>',
    ]
    parts += [_arrow(*(places[name] for name in arrow.split())) for arrow in arrows]
    parts += _through_water(places)
    for name, place in places.items():
        parts.append(_box(name, place, name in ports, name in ends, texts.get(name, "")))
    return "\n".join([*parts, "</svg>"])


def _corner(place: Place) -> tuple[float, float]:
    return place[0] * ACROSS, place[1] * DOWN


def _through_water(places: dict[str, Place]) -> list[str]:
    """How the speeds of a hull come back to the forces on it, by way of those through the water."""
    half, lines = HEIGHT / 2, []
    for state in ("surge", "sway"):
        if (water := f"{state}_through_water") in places:
            (x0, y0), (x1, y1) = _corner(places[state]), _corner(places[water])
            out = x0 + WIDTH + (6 if state == "surge" else 12)
            lines.append(f"M{x0 + WIDTH} {y0 + half} H{out} V{y1 + half} H{x1 + WIDTH + 1}")
            back = x1 - ACROSS - 8
            for force in ("surge_force", "sway_force", "yaw_moment"):
                x2, y2 = _corner(places[force])
                lines.append(f"M{x1} {y1 + half} H{back} V{y2 + half + 9} H{x2 - 1}")
    dashed = 'stroke-width="1.2" stroke-dasharray="4 3" marker-end="url(#tip)"'
    return [f'<path d="{line}" {dashed}/>' for line in lines]


def _arrow(start: Place, end: Place) -> str:
    (x0, y0), (x1, y1) = _corner(start), _corner(end)
    half = HEIGHT / 2
    if y0 == y1:
        forward = x1 > x0
        xa, xb = (x0 + WIDTH, x1 - 1) if forward else (x0, x1 + WIDTH + 1)
        line = f"M{xa} {y0 + half} L{xb} {y1 + half}"
    elif x1 > x0 and y1 > y0 and x1 - x0 > ACROSS:
        line = f"M{x0 + WIDTH / 2} {y0 + HEIGHT} V{y1 + half} H{x1 - 1}"
    elif x1 >= x0:
        line = f"M{x0 + WIDTH} {y0 + half} H{x0 + WIDTH + 13} V{y1 + half} H{x1 - 1}"
        if x1 == x0:
            line = f"M{x0 + WIDTH / 2} {y0 + HEIGHT} V{y1 - 1}"
            line = line if y1 > y0 else f"M{x0 + WIDTH / 2} {y0} V{y1 + HEIGHT + 1}"
    else:
        up = y1 < y0
        side = y0 if up else y0 + HEIGHT
        other = y1 + HEIGHT + 1 if up else y1 - 1
        turn = (side + other) / 2
        line = f"M{x0 + WIDTH / 2} {side} V{turn} H{x1 + WIDTH / 2} V{other}"
    return f'<path d="{line}" stroke-width="1.2" marker-end="url(#tip)"/>'


def _box(name: str, place: Place, marked: bool, end: bool, text: str) -> str:
    x, y = _corner(place)
    colour, thick = (MARKED, 3) if marked else ("currentColor", 1)
    fill = f'fill="{MARKED}" fill-opacity="0.15"' if marked else 'fill="none"'
    weight = ' font-weight="bold"' if marked else ""
    shown = escape(name.replace("_", " "))
    tip = f"<title>{escape(text)}</title>" if text else ""
    return (
        f'<g>{tip}<rect x="{x}" y="{y}" width="{WIDTH}" height="{HEIGHT}" '
        f'rx="{HEIGHT / 2 if end else 3}" stroke="{colour}" stroke-width="{thick}" {fill}/>'
        f'<text x="{x + WIDTH / 2}" y="{y + HEIGHT / 2 + 4}" text-anchor="middle" '
        f'stroke="none" fill="currentColor"{weight}>{shown}</text></g>'
    )
