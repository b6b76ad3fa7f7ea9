"""Thirty figures of known motions: how they are drawn, described, digitised and compared."""

from dataclasses import dataclass

import numpy as np
from digitise.rendered import Look, draw
from phase_loops import FREQUENCY, clapping

from calib.digitise import digitise
from calib.features.phase_curve import PhaseCurve
from calib.objective import Objective, Reference, Term
from calib.records.excitation import Excitation

COLOURS = (("#0072B2", "#D55E00"), ("#1f77b4", "#d62728"), ("#009E73", "#000000"))
BLACK = ("#000000", "#000000")


@dataclass(frozen=True)
class Case:
    """A figure: the motion of the layer, size and offset [mm] of the beam's beside it (None: not drawn), the look."""

    jump: float
    impact: float
    beam: tuple[float, float] | None
    look: Look


def cases():
    """Thirty: 150 and 300 dpi, PNG and JPEG, colour and black with dashes, grid, one degree, loops that cross."""
    found = []
    for k in range(30):
        black = k % 3 == 2
        beam = (None, (1.0, 0.0), (1.3, -1.6))[(k // 2) % 3] if not black else ((1.2, 1.9), (1.3, -1.6))[k % 2]
        look = Look(
            dpi=(150, 300)[k % 2],
            form=("png", "jpg")[(k // 2) % 2],
            colours=BLACK if black else COLOURS[k % 3],
            dashes=(("-", "--"), ("--", "-"), ("-", "-."), ("-", ":"))[(k // 3) % 4] if black else ("-", "-"),
            grid=bool((k // 4) % 2),
            turn=(0.0, 1.0, -1.0)[(k // 5) % 3],
            shear=0.01 if k % 7 == 3 else 0.0,
            width=(1.0, 1.4, 2.0)[k % 3],
        )
        found.append(Case(0.3 + 0.05 * (k % 9), 0.24 + 0.02 * (k % 5), beam, look))
    return found


def motion(case):
    """Record of the motion that is drawn: beam and layer, one period, 4000 samples."""
    return clapping(jump=case.jump, impact=case.impact, periods=1, samples=4000)


def curve(record, body, size=1.0, offset=0.0):
    """Closed curve in mm and m/s."""
    one = record.sel(body=body)
    points = size * np.column_stack([1e3 * one.displacement.values, one.velocity.values]) + (offset, 0.0)
    return np.vstack([points, points[:1]])


def description(drawn, case, body, frequency=True, points=None):
    """TOML of the figure, for one body."""
    (left, right), (low, high) = drawn.limits
    dx, dy = 0.008 * (right - left), 0.01 * (high - low)  # the frame is left out
    index = 0 if body == "layer" else 1
    same = case.look.colours[0] == case.look.colours[1] and case.beam is not None
    dashed = f"dashed = {str(case.look.dashes[index] != '-').lower()}\n" if same else ""
    points = points or drawn.points
    rows = [f"{{ pixel = {p['pixel']}, x = {p['x']!r}, y = {p['y']!r} }}" for p in points]
    listed = ",\n  ".join(rows)
    stated = f'frequency = "{FREQUENCY} Hz"\n' if frequency else ""
    return (
        f'source = "drawn"\n[excitation]\nplace = "end"\nquantity = "displacement"\namplitude = "1.5 mm"\n{stated}\n'
        f'[[panel]]\nname = "a"\nx = {{ unit = "mm", low = {left + dx}, high = {right - dx} }}\n'
        f'y = {{ unit = "m/s", low = {low + dy}, high = {high - dy} }}\npoints = [\n  {listed},\n]\n\n'
        f'[[curve]]\nbody = "{body}"\nkind = "phase curve"\npanel = "a"\n'
        f'colour = "{case.look.colours[index]}"\n{dashed}'
    )


def round_trip(case, folder, number=0, body="layer", frequency=True):
    """Draw, digitise and compare one figure: the digitised, the drawn record, and the distance of the objective."""
    drawn_record = motion(case)
    loops = [curve(drawn_record, "layer")]
    if case.beam is not None:
        loops.append(curve(drawn_record, "beam", *case.beam))
    drawn = draw(folder / f"figure_{number}", loops, case.look)
    spec = folder / f"figure_{number}.toml"
    spec.write_text(description(drawn, case, body, frequency))
    digitised = digitise(drawn.path, spec)
    return digitised, drawn_record, compared(digitised.record, drawn_record, body)


def compared(recovered, drawn, body):
    """Objective's own distance of the phase curves, the recovered one as the reference; and its aligned record."""
    drive = Excitation("end", "displacement", frequency=recovered.attrs["frequency"], amplitude=1.5e-3)
    reference = Reference("figure", recovered, nuisance=("trigger",), excitation=drive)
    objective = Objective({"figure": reference}, [Term(PhaseCurve(), bodies=[body])])
    simulated = drawn.sel(body=[body])
    score = objective({"figure": simulated})
    return score, objective.aligned("figure", simulated)


def misses(recovered, aligned, body):
    """Errors over the stated standard uncertainty (channel, time), where the drawn motion does not jump."""
    found = []
    for channel in ("displacement", "velocity"):
        error = recovered[channel].sel(body=body).values - aligned[channel].sel(body=body).values
        found.append(error / recovered[f"{channel}_sigma"].sel(body=body).values)
    return np.array(found)
