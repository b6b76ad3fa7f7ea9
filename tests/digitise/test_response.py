"""Printed response curves become frequency responses: there and back, and what is refused."""

import io

import matplotlib as mpl
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from calib.cli import main
from calib.digitise import digitise
from calib.digitise.importers.imported import CLICK_SIGMA
from calib.errors import CalibError
from calib.records import read
from calib.records.response import complex_amplitude, has_phase, sweeps
from calib.study.result import read as read_result

STIFFNESS, DAMPING = 400.0, 1.5  # N/m, N s/m, of 1 kg: 3.18 Hz
COLOURS = {0.2: "#0072B2", 0.5: "#D55E00", 1.0: "#000000"}  # by level [N]
FREQUENCIES = np.linspace(2.4, 4.2, 37)  # Hz, of the measured points


def displacement(frequency, level):
    """Complex amplitude  [m]."""
    omega = 2.0 * np.pi * frequency
    return level / (STIFFNESS - omega**2 + 1j * DAMPING * omega)


def acceleration(frequency, level):
    """Complex amplitude  [m/s^2]."""
    return -((2.0 * np.pi * frequency) ** 2) * displacement(frequency, level)


AXES = {  # what is drawn over the frequency: unit and scale of the axis, and the numbers on it
    "mm": ("linear", lambda f, level: 1e3 * abs(displacement(f, level))),
    "um": ("log", lambda f, level: 1e6 * abs(displacement(f, level))),
    "m/s^2": ("log", lambda f, level: abs(acceleration(f, level))),
    "dB re 1 um": ("linear", lambda f, level: 20.0 * np.log10(1e6 * abs(displacement(f, level)))),
}


def drawn(folder, unit, with_phase=True, levels=tuple(COLOURS), motion=displacement):
    """Draw curves through measured points, amplitude above phase; return the picture and its description."""
    scale, shown = AXES[unit]
    with mpl.rc_context({"path.simplify": False}):
        figure = Figure(figsize=(5.2, 5.6), dpi=150)
        canvas = FigureCanvasAgg(figure)
        upper, lower = figure.add_axes((0.15, 0.45, 0.81, 0.51)), figure.add_axes((0.15, 0.1, 0.81, 0.28))
        for level in levels:
            look = {"color": COLOURS[level], "marker": "o", "markersize": 2.2, "linewidth": 1.4}
            upper.plot(FREQUENCIES, shown(FREQUENCIES, level), **look)
        for level in levels[:1]:  # of a linear mode it is the same at all levels
            phase = np.degrees(np.unwrap(np.angle(motion(FREQUENCIES, level))))
            lower.plot(FREQUENCIES, phase, color="black", linewidth=1.4)
        upper.set(yscale=scale, ylabel=f"Amplitude [{unit}]")
        lower.set(xlabel="Frequency [Hz]", ylabel="Phase [deg]")
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3])
        panels = [panel(axes, "Hz", own, picture.height) for axes, own in ((upper, unit), (lower, "deg"))]
    stored = io.BytesIO()
    picture.save(stored, format="PNG")
    (folder / "figure.png").write_bytes(stored.getvalue())
    text = 'source = "drawn"\n[excitation]\nplace = "mass"\nquantity = "force"\n'
    for name, table in zip(("amplitude", "phase"), panels, strict=True):
        text += f'[[panel]]\nname = "{name}"\n{table}'
    for level in levels:
        kinds = [("amplitude", COLOURS[level]), *([("phase", "black")] if with_phase else [])]
        for kind, colour in kinds:
            text += f'[[curve]]\nbody = "mass"\nkind = "{kind} over frequency"\npanel = "{kind}"\n'
            text += f'colour = "{colour}"\nlevel = "{level} N"\n'
    (folder / "figure.toml").write_text(text)
    return folder / "figure.png", folder / "figure.toml"


def panel(axes, across, up, height):
    """TOML of a panel: units, limits just inside the frame, axis points at the ticks."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    scale = axes.get_yscale()
    x, y = ([t for t in ticks if a < t < b] for ticks, a, b in (
        (axes.get_xticks(), left, right), (axes.get_yticks(), low, high)))  # fmt: skip
    rows = []
    for corner in ((x[0], y[0]), (x[-1], y[0]), (x[0], y[-1]), (x[-1], y[-1])):
        column, row = axes.transData.transform(corner)
        rows.append(
            f"{{ pixel = [{round(column - 0.5)}, {round(height - row - 0.5)}], x = {corner[0]}, y = {corner[1]} }}"
        )
    inner = (low * (high / low) ** 0.01, high / (high / low) ** 0.01) if scale == "log" else (
        low + 0.01 * (high - low), high - 0.01 * (high - low))  # fmt: skip
    margin = 0.008 * (right - left)
    return (
        f'x = {{ unit = "{across}", low = {left + margin}, high = {right - margin} }}\n'
        f'y = {{ unit = "{up}", low = {inner[0]}, high = {inner[1]}, scale = "{scale}" }}\n'
        f"points = [{', '.join(rows)}]\n"
    )


@pytest.mark.parametrize("unit", AXES)
def test_curves_of_several_levels_come_back_within_their_uncertainty(tmp_path, unit):
    motion = acceleration if unit == "m/s^2" else displacement
    record = digitise(*drawn(tmp_path, unit, motion=motion)).record
    assert [record.level.values[points[0]] for _, points in sweeps(record)] == pytest.approx([0.2, 0.5, 1.0])
    assert (record.attrs["place"], record.attrs["quantity"]) == ("mass", "force")
    for _, points in sweeps(record):
        frequency, level = record.frequency.values[points], record.level.values[points]
        assert points.size > 40
        own, truth = complex_amplitude(record)[0, points], displacement(frequency, level)
        slope = np.abs(displacement(frequency + 0.01, level) - displacement(frequency - 0.01, level)) / 0.02
        sigma = np.hypot(record.response_sigma.values[0, points], slope * record.frequency_sigma.values[points])
        chord = 0.01 * np.abs(truth)  # the line through the points is straight between them
        assert (np.abs(own - truth) < 3.0 * sigma + chord).mean() > 0.95
        assert np.abs(own - truth).max() < 0.04 * np.abs(truth).max()


STUDY = """
[study]
name = "printed"
seed = 1
budget = 40

[[record]]
name = "figure"
path = "figure.nc"

[model]
simulator = "oscillator"
fixed = { mass = "1 kg" }

[windows]
stiffness = { low = 360.0, high = 440.0 }
damping = { low = 1.0, high = 3.0, scale = "log" }

[[term]]
feature = "frequency_response"
"""


@pytest.mark.parametrize(
    ("with_phase", "levels"), [(True, (0.2, 0.5)), pytest.param(False, (0.5,), marks=pytest.mark.slow)]
)
def test_a_printed_response_calibrates_the_oscillator_that_drew_it(tmp_path, without_pictures, with_phase, levels):
    picture, spec = drawn(tmp_path, "mm", with_phase, levels)
    runner = CliRunner()
    done = runner.invoke(main, ["digitise", str(picture), "--spec", str(spec), "-o", str(tmp_path / "figure.nc")])
    assert done.exit_code == 0, done.output
    assert has_phase(read(tmp_path / "figure.nc")) == with_phase
    (tmp_path / "study.toml").write_text(STUDY)
    done = runner.invoke(main, ["run", str(tmp_path / "study.toml"), "--quiet"])
    assert done.exit_code == 0, done.output
    result = read_result(tmp_path / "out")
    for name, truth in (("stiffness", STIFFNESS), ("damping", DAMPING)):
        low, high = result.intervals[name]
        assert abs(result.values[name] - truth) < max(1.5 * (high - low), 0.01 * truth)
    assert result.values["stiffness"] == pytest.approx(STIFFNESS, rel=0.005)
    assert result.values["damping"] == pytest.approx(DAMPING, rel=0.03)


# --- exports

WPD = "up,,down,,lag,\nX,Y,X,Y,X,Y\n3.4,2.1,3.4,1.0,3.4,-150\n3.0,1.9,3.0,0.9,2.9,-20\n3.2,6.0,3.2,3.0,3.2,-90\n"
SPEC = """
source = "Author, Journal 1 (2000), Fig. 3"
[excitation]
place = "mass"
quantity = "force"
amplitude = "0.5 N"
[[curve]]
body = "mass"
kind = "amplitude over frequency"
name = "up"
units = ["Hz", "mm"]
sigma = ["0.01 Hz", "0.1 mm"]
[[curve]]
body = "mass"
kind = "phase over frequency"
name = "lag"
units = ["Hz", "deg"]
"""


def export(folder, spec, points=WPD):
    (folder / "export.csv").write_text(points)
    (folder / "export.toml").write_text(spec)
    return digitise(folder / "export.csv", folder / "export.toml").record


def test_points_of_an_export_are_those_of_the_record(tmp_path):
    record = export(tmp_path, SPEC)
    np.testing.assert_allclose(record.frequency, [3.0, 3.2, 3.4])  # clicked in another order
    np.testing.assert_allclose(np.abs(complex_amplitude(record)[0]), [1.9e-3, 6e-3, 2.1e-3])
    np.testing.assert_allclose(np.degrees(np.angle(complex_amplitude(record)[0])), [-20.0 - 70.0 / 3.0, -90.0, -150.0])
    np.testing.assert_allclose(record.level, 0.5)
    np.testing.assert_allclose(record.frequency_sigma, 0.01, rtol=0.5)
    assert "Author, Journal 1 (2000), Fig. 3; digitised from export.csv" in record.attrs["source"]


def test_a_sweep_down_is_a_curve_of_its_own(tmp_path):
    down = SPEC[SPEC.index("[[curve]]") : SPEC.rindex("[[curve]]")].replace('"up"', '"down"') + 'direction = "down"\n'
    record = export(tmp_path, SPEC[: SPEC.rindex("[[curve]]")] + down)
    assert [record.direction.values[points].tolist() for _, points in sweeps(record)] == [[-1.0] * 3, [1.0] * 3]
    assert not has_phase(record)
    np.testing.assert_allclose(record.in_phase[0], [1e-3, 3e-3, 0.9e-3, 1.9e-3, 6e-3, 2.1e-3])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('amplitude = "0.5 N"\n', "", r"export.toml:6: curve\[1\]: the level is missing"),
        ('units = ["Hz", "mm"]', 'units = ["Hz", "deg"]', "expected a unit of displacement, velocity or acceleration"),
        ('units = ["Hz", "deg"]', 'units = ["Hz", "mm"]', "can be given in rad"),
        ('units = ["Hz", "mm"]', 'units = ["ms", "mm"]', "can be given in Hz"),
        ('units = ["Hz", "mm"]', 'units = ["Hz", "dB"]', "expected a unit of displacement"),
        ('name = "up"', 'name = "up"\nlevel = "1 mm"', "can be given in N"),
        ('name = "up"', 'name = "up"\nof = "velocity"', "of belongs to a phase over frequency"),
        (
            'name = "up"',
            'name = "up"\nlevel = "1 N"',
            "the phase of 'mass' over the frequency is missing at 1 N, up",
        ),
        ('kind = "phase over frequency"', 'kind = "displacement over time"', "over frequency or over time"),
        (
            'kind = "phase over frequency"',
            'kind = "amplitude over frequency"',
            "two curves are the amplitude over freq",
        ),
    ],
)
def test_what_makes_no_response_is_refused(tmp_path, old, new, message):
    assert old in SPEC
    spec = SPEC.replace(old, new)
    if "displacement over time" in new:
        spec = spec.replace('["Hz", "deg"]', '["ms", "mm"]')
    elif new == 'kind = "amplitude over frequency"':
        spec = spec.replace('["Hz", "deg"]', '["Hz", "mm"]').replace('"lag"', '"down"')
    with pytest.raises(CalibError, match=message):
        export(tmp_path, spec)


def test_a_level_of_another_kind_of_curve_is_refused(tmp_path):
    spec = SPEC.replace("amplitude over frequency", "displacement over time").replace('["Hz", "mm"]', '["ms", "mm"]')
    with pytest.raises(CalibError, match="level belongs to a curve over frequency"):
        export(tmp_path, spec[: spec.rindex("[[curve]]")].replace('name = "up"', 'name = "up"\nlevel = "1 N"'))


def test_a_phase_that_begins_anew_at_the_other_end_of_its_axis_is_interpolated_across(tmp_path):
    frequency = np.arange(10.0, 20.1, 0.5)
    turning = -20.0 * (frequency - 10.0) - 85.0  # deg, past -180 between 14.5 and 15 Hz
    wrapped = (turning + 180.0) % 360.0 - 180.0
    between = frequency + 0.21
    lines = [f"{b:.4f},2.0,{f:.4f},{p:.4f}" for b, f, p in zip(between, frequency, wrapped, strict=True)]
    spec = SPEC + 'sigma = ["0.01 Hz", "1 deg"]\n'
    record = export(tmp_path, spec, "\n".join(["up,,lag,", "X,Y,X,Y", *lines]))
    own, at = complex_amplitude(record)[0], record.frequency.values
    expected = np.deg2rad(-20.0 * (at - 10.0) - 85.0)
    assert np.abs(np.angle(own * np.exp(-1j * expected))).max() < np.deg2rad(0.5)


# --- documents of Engauge

DECADE, COLUMNS = 120.0, 200.0  # pixels: of a decade of the amplitude, of 1 Hz


def clicked_document(amplitudes, lags):
    """Write what Engauge keeps of curves clicked over a linear and a logarithmic axis: {name: (frequency, value)}."""

    def point(frequency, height, graph=""):
        x, y = 40.0 + COLUMNS * (frequency - 2.0), 400.0 - DECADE * height
        return f'<Point><PositionScreen X="{x:.12g}" Y="{y:.12g}"/>{graph}</Point>'

    def system(scale, curves, heights, axis):
        on_axes = [
            point(f, heights(value), f'<PositionGraph X="{f}" Y="{value}"/>')
            for f, value in ((2.0, axis[0]), (5.0, axis[0]), (2.0, axis[1]))
        ]
        parts = [
            f'<CoordSystem><Coords TypeString="Cartesian" ScaleXThetaString="Linear" ScaleYRadiusString="{scale}" '
            'UnitsXString="Number" UnitsYString="Number"/>',
            f'<Curve CurveName="Axes"><CurvePoints>{"".join(on_axes)}</CurvePoints></Curve><CurvesGraphs>',
        ]
        for name, (frequency, value) in curves.items():
            points = "".join(point(f, heights(v)) for f, v in zip(frequency, value, strict=True))
            parts.append(f'<Curve CurveName="{name}"><CurvePoints>{points}</CurvePoints></Curve>')
        return "".join([*parts, "</CurvesGraphs></CoordSystem>"])

    upper = system("Log", amplitudes, np.log10, (0.1, 100.0))
    lower = system("Linear", lags, lambda value: value / 60.0, (-180.0, 0.0))
    return f'<Document VersionNumber="12.1" AxesPointsRequired="0">{upper}{lower}</Document>'


def test_a_document_of_engauge_over_a_logarithmic_axis_becomes_a_response(tmp_path):
    frequency, between = np.linspace(2.5, 4.0, 16), np.linspace(2.45, 4.05, 17)
    curves = {f"{level} N": (frequency, 1e3 * abs(displacement(frequency, level))) for level in (0.2, 1.0)}
    lag = {"lag": (between, np.degrees(np.angle(displacement(between, 1.0))))}
    (tmp_path / "figure.dig").write_text(clicked_document(curves, lag))
    spec = SPEC[: SPEC.index("[[curve]]")]
    for level in (0.2, 1.0):
        for kind, name, unit in (("amplitude", f"1: {level} N", "mm"), ("phase", "2: lag", "deg")):
            spec += f'[[curve]]\nbody = "mass"\nkind = "{kind} over frequency"\nname = "{name}"\n'
            spec += f'units = ["Hz", "{unit}"]\nlevel = "{level} N"\n'
    (tmp_path / "figure.toml").write_text(spec)
    record = digitise(tmp_path / "figure.dig", tmp_path / "figure.toml").record
    truth = displacement(record.frequency.values, record.level.values)
    np.testing.assert_allclose(np.abs(complex_amplitude(record)[0]), np.abs(truth), rtol=1e-9)
    slope = np.abs(np.gradient(np.angle(displacement(frequency, 1.0)), frequency)).max()
    assert np.abs(np.angle(complex_amplitude(record)[0] / truth)).max() < 0.05 * slope  # linear from click to click
    click = record.response_sigma.values[0] / np.abs(truth)  # of one pixel, on this axis a share of the amplitude
    assert click.min() == pytest.approx(np.log(10.0) / DECADE * CLICK_SIGMA, rel=0.15)
    assert click.max() < 2.5 * click.min()  # at the resonance, where the phase is steep between the clicks
    across = record.frequency_sigma.values * COLUMNS / CLICK_SIGMA  # more than one click's: those of the axes err too
    assert ((across > 1.0) & (across < 2.0)).all()
