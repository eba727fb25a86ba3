"""The layout of a recording: scene at the left, plots at the right, events and the script's line below."""

from __future__ import annotations

import rerun.blueprint as rrb

from vpframe.view.camera import Camera

DISTANCE = 3.0
"""distance of the eye, in radii of the camera, for rerun's field of view"""


def blueprint(camera: Camera) -> rrb.Blueprint:
    """Return the layout of a recording, with the view of `camera`."""
    from_start = rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                "time", start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
            )
        ]
    )
    scene = rrb.Spatial3DView(
        name="Scene",
        origin="/",
        contents=["/parts/**", "/still/**", "/symbols/**", "/trail/**"],
        background=rrb.Background(color=[225, 230, 237]),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=camera.target + DISTANCE * camera.radius * camera.axes()[2],
            look_target=camera.target,
            eye_up=camera.up,
        ),
        overrides={"trail": from_start},
    )
    plots = rrb.Vertical(
        rrb.StateTimelineView(name="Constraints", origin="/constraints"),
        _plot("Freedom left", "/plots/freedom"),
        _plot("Clearance", "/plots/clearance"),
        rrb.Tabs(
            _plot("Colliding surface pairs", "/plots/clashes"), _plot("Time a step", "/plots/timings"), active_tab=0
        ),
    )
    below = rrb.Horizontal(
        rrb.TextLogView(
            name="Events",
            origin="/events",
            columns=rrb.TextLogColumns(
                timeline_columns=[rrb.encodings.TimelineColumn("time")],
                text_log_columns=[rrb.encodings.TextLogColumn("body")],
            ),
        ),
        rrb.TextDocumentView(name="Script", origin="/script"),
        column_shares=[3, 1],
    )
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(scene, plots, column_shares=[3, 2]), below, row_shares=[3, 1]),
        rrb.BlueprintPanel(state=rrb.PanelState.Collapsed),
        rrb.SelectionPanel(state=rrb.PanelState.Collapsed),
        rrb.TimePanel(state=rrb.PanelState.Collapsed, timeline="time"),
        auto_views=False,
        auto_layout=False,
    )


def _plot(name: str, origin: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(name=name, origin=origin, plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop))
