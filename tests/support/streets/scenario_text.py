"""OpenSCENARIO files written by hand."""

VERTEX = '<Vertex time="{}"><Position><WorldPosition x="{}" y="{}" {}/></Position></Vertex>'
LINE = VERTEX.format(0, 5, 6, "") + VERTEX.format(2, 9, 6, "")
TIMING = '<TimeReference><Timing domainAbsoluteRelative="{}" scale="1" offset="0.5"/></TimeReference>'
ABSOLUTE = TIMING.format("absolute")
BOX = '<Vehicle><BoundingBox><Center x="1.5" y="0.5" z="0.7"/></BoundingBox></Vehicle>'


def write_scenario_text(tmp_path, line=LINE, timing=ABSOLUTE, shape="Polyline", start="", names=("Van",), head=""):
    """A scenario by hand: every entity follows the same line; the Van has a box."""
    action = (
        f"<FollowTrajectoryAction><TrajectoryRef><Trajectory><Shape><{shape}>{line}</{shape}></Shape></Trajectory>"
        f"</TrajectoryRef>{timing}</FollowTrajectoryAction>"
    )
    groups = "".join(
        f'<ManeuverGroup><Actors><EntityRef entityRef="{name}"/></Actors><Maneuver><Event name="e"><Action>'
        f"<PrivateAction><RoutingAction>{action}</RoutingAction></PrivateAction></Action>{start}</Event></Maneuver>"
        "</ManeuverGroup>"
        for name in names
    )
    path = tmp_path / "drive.xosc"
    path.write_text(
        f'{head}<OpenSCENARIO><Entities><ScenarioObject name="Van">{BOX}</ScenarioObject></Entities>'
        f"<Storyboard><Init><Actions/></Init><Story><Act>{groups}</Act></Story></Storyboard></OpenSCENARIO>"
    )
    return path
