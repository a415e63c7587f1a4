"""The picture of a certificate: the band, a run inside it, and what the ideal input has left."""

from __future__ import annotations

from typing import TYPE_CHECKING

from foreswitch._helpers.check import Array
from foreswitch.certificate.ideal_response import Course
from foreswitch.presentation import plots
from foreswitch.simulation.loop import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from foreswitch.simulation.run import Run

__all__ = ["band"]

BAND, LIMIT = "#0072B2", "#D55E00"


def band(course: Course, y: Array, u: Array, bound: Array, allowed: tuple[Array, Array], run: Run | None) -> Figure:
    """For each output the response and the deviation, each with its band; then the ideal inputs with their range."""
    controller, t = course.controller, course.t
    if run is None:
        run = simulate(
            controller, course.reference, course.duration, x0=course.x0,
            disturbance=course.disturbance if course.disturbance.shape[1] else None,
        )  # fmt: skip
    q, m = y.shape[1], u.shape[1]
    heights = [2.2, 1.3] * q + [1.0] * m
    fig = plots.figure(2 * q + m, size=(7.2, 3.6 * q + 1.2 * m + 0.5), heights=heights)
    factor, label = plots.time_scale(float(t[-1] - t[0]))
    time = t * factor
    for i in range(q):
        name = controller.plant.output_names[i]
        above, below = fig.axes[2 * i : 2 * i + 2]
        above.fill_between(
            time, y[:, i] - bound[i], y[:, i] + bound[i], color=BAND, alpha=0.25, linewidth=0.0, label="certified"
        )
        plots.draw_output(above, time, run.y[:, i], run.r[:, i], label="output")
        above.set_ylabel(name, fontsize=9)
        above.legend(fontsize=8, frameon=False)
        below.axhspan(-bound[i], bound[i], color=BAND, alpha=0.15, linewidth=0.0)
        below.plot(time, (run.y - y)[:, i], color=BAND, linewidth=0.9)
        below.set_ylabel("output - ideal", fontsize=9)
    for j, axes in enumerate(fig.axes[2 * q :]):
        plots.draw_command(axes, time, u[:, j], label="ideal input")
        for limit in allowed:
            axes.axhline(limit[j], color=LIMIT, linewidth=0.9, linestyle="--")
        axes.set_ylabel(f"ideal {controller.plant.input_names[j]}", fontsize=9)
    fig.axes[-1].set_xlabel(label, fontsize=9)
    return fig
