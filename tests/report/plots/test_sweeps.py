"""Claims about the pictures of sweeps: what is there is drawn, what failed is not, and each axis says its unit."""

import numpy as np
import pytest
import xarray as xr

from calib.errors import CalibError
from calib.report.plots.bifurcation import bifurcation_diagram, impact_diagram
from calib.report.plots.continuation import branch_diagram
from calib.report.plots.maps import kind_map
from calib.report.plots.sections import basin_map, sections
from calib.report.plots.sweeps import KIND_COLOURS, binned_kind, in_order, plain_kind, swept

MILLI = 1e-3
ATTRS = {"model": "cubic map", "phase": 0.25}


def cubic(a, b, x=0.3, cycles=100, settle=400):
    """Section (cycle,), velocity and exponent of the map x -> a x - x^3 + b, which has two attractors for some b."""
    kept, growth = [], 0.0
    for n in range(settle + cycles):
        slope = abs(a - 3.0 * x * x)
        x = a * x - x**3 + b
        if abs(x) > 10.0:
            return np.full(cycles, np.nan), np.nan
        if n >= settle:
            kept.append(x)
            growth += np.log(slope + 1e-300)
    return np.array(kept), growth / cycles


def motion(section, exponent):
    """Kind and period."""
    if np.isnan(exponent):
        return "failed", 0
    for n in range(1, 33):
        if np.abs(section[n:] - section[:-n]).max() < 1e-6:
            return f"period-{n}", n
    return ("chaotic" if exponent > 0.02 else "undecided"), 0


def sweep_of(runs, dims, coords, cycles=100):
    """Dataset of a sweep from runs, an array of (section, exponent) over `dims`."""
    shape = runs.shape
    section = np.array([r[0] for r in runs.ravel()]).reshape(*shape, cycles)
    exponent = np.array([r[1] for r in runs.ravel()]).reshape(shape)
    kinds = [motion(*r) for r in runs.ravel()]
    period = np.array([n for _, n in kinds]).reshape(shape)
    lead, rest = (("branch",), dims[1:]) if dims[0] == "branch" else ((), dims)
    order = (*lead, "body", "cycle", *rest)
    bodies = np.stack([MILLI * section, 0.1 * MILLI * section**2], axis=-2)  # (..., body, cycle)
    channels = {
        "displacement": xr.DataArray(bodies, dims=(*dims, "body", "cycle")).transpose(*order).assign_attrs(units="m"),
        "velocity": xr.DataArray(np.roll(bodies, 1, axis=-1) * 1e3, dims=(*dims, "body", "cycle"))
        .transpose(*order)
        .assign_attrs(units="m/s"),
    }
    impact = np.where(section > 0.0, (0.3 + 0.1 * section) % 1.0, np.nan)
    along = (*lead, "impact", *rest)
    return xr.Dataset(
        {
            **channels,
            "kind": (dims, np.array([k for k, _ in kinds], dtype=object).reshape(shape)),
            "period": (dims, period),
            "impacts": (dims, np.where(period > 0, (period + 1) // 2, -1)),
            "exponent": (dims, exponent),
            "impact_phase": xr.DataArray(impact, dims=(*dims, "impact")).transpose(*along),
            "impact_speed": xr.DataArray(0.2 * np.abs(impact), dims=(*dims, "impact")).transpose(*along),
        },
        coords={"body": ["beam", "layer"], **coords},
        attrs=ATTRS,
    )


def array_of(runs, shape):
    array = np.empty(len(runs), dtype=object)
    array[:] = runs
    return array.reshape(shape)


def coordinate(dim, values, name, unit):
    return xr.DataArray(values, dims=dim, attrs={"units": unit, "meaning": "made up", "name": name})


def one_parameter(count=60, low=1.0, high=3.05):
    """The cubic map over a: doublings, chaos, and failures at the end."""
    values = np.linspace(low, high, count)
    runs = array_of([cubic(a, 0.05) for a in values], (count,))
    return sweep_of(runs, ("drive_gain",), {"drive_gain": coordinate("drive_gain", values, "drive.gain", "1")})


def there_and_back(count=60, a=1.9, high=0.9):
    """The cubic map over b, carried forward and backward: hysteresis."""
    values = np.linspace(-high, high, count)
    forward, backward = [], []
    for order, runs in ((values, forward), (values[::-1], backward)):
        x = 0.1
        for b in order:
            runs.append(cubic(a, b, x if np.isfinite(x) else 0.1))
            x = runs[-1][0][-1]
    runs = array_of(forward + backward[::-1], (2, count))
    coords = {"branch": ["forward", "backward"], "offset": coordinate("offset", MILLI * values, "offset", "m")}
    return sweep_of(runs, ("branch", "offset"), coords)


def two_parameters(first=24, second=16):
    a, b = np.linspace(0.5, 3.2, first), np.linspace(-0.5, 0.5, second)
    runs = array_of([cubic(x, y) for x in a for y in b], (first, second))
    coords = {"gain": coordinate("gain", a, "gain", "1"), "offset": coordinate("offset", MILLI * b, "offset", "m")}
    return sweep_of(runs, ("gain", "offset"), coords)


def scattered(count=80, seed=3):
    a, b = np.random.default_rng(seed).uniform([[0.5], [-0.5]], [[3.2], [0.5]], (2, count))
    runs = array_of([cubic(x, y) for x, y in zip(a, b, strict=True)], (count,))
    coords = {"gain": coordinate("point", a, "gain", "1"), "offset": coordinate("point", MILLI * b, "offset", "m")}
    return sweep_of(runs, ("point",), coords)


def as_starts(sweep, count=4):
    parts = [
        sweep.assign(displacement=(1.0 - 0.1 * k) * sweep.displacement.assign_attrs(units="m")) for k in range(count)
    ]
    joined = xr.concat(parts, dim="branch", combine_attrs="override")
    joined.displacement.attrs["units"] = "m"
    return joined.assign_coords(branch=[f"start {k + 1}" for k in range(count)])


def all_failed(sweep):
    floats = {name: np.nan * v for name, v in sweep.data_vars.items() if v.dtype.kind == "f"}
    kind = xr.full_like(sweep.kind, "failed")
    return sweep.assign(**floats, kind=kind, period=0 * sweep.period, impacts=0 * sweep.impacts - 1)


def basins():
    x, v = np.linspace(-2e-3, 2e-3, 40), np.linspace(-1.0, 1.0, 30)
    attractor = np.where(v[:, None] > 600.0 * x, 1, 0)
    attractor[0, :4] = -1
    places = np.array([[-1e-3, -0.5e-3, np.nan], [1e-3, np.nan, np.nan]])
    return xr.Dataset(
        {
            "attractor": (("q3.velocity", "q3.displacement"), attractor),
            "attractor_kind": ("attractor", np.array(["period-2", "chaotic"], dtype=object)),
            "section_x": (("attractor", "cycle"), places),
            "section_y": (("attractor", "cycle"), 400.0 * places),
        },
        coords={
            "q3.velocity": ("q3.velocity", v, {"units": "m/s"}),
            "q3.displacement": ("q3.displacement", x, {"units": "m"}),
        },
        attrs=ATTRS,
    )


def followed():
    """A branch that turns around once: unstable between its first fold and its end."""
    step = np.linspace(-1.0, 1.0, 41)
    places = MILLI * (0.5 - 0.4 * step**2)
    return xr.Dataset(
        {
            "displacement": (("body", "cycle", "step"), MILLI * np.array([[step], [3.0 * step]]), {"units": "m"}),
            "stable": ("step", step < 0.0),
            "multiplier_modulus": (("multiplier", "step"), np.array([1.0 + step, np.full(41, 0.2)])),
            "special_kind": ("special", np.array(["fold", "grazing"], dtype=object)),
            "special_parameter": ("special", places[[20, 40]]),
            "special_index": ("special", [20, 40]),
        },
        coords={"body": ["beam", "layer"], "parameter": ("step", places, {"units": "m", "name": "offset"})},
        attrs=ATTRS,
    )


# --- what a figure shows -------------------------------------------------------------------------------------------


def labels(figure):
    """Label of every axis whose ticks have numbers at them."""
    shown = [axes for axes in figure.axes if axes.get_visible()]
    sides = [(axes.xaxis, "labelbottom") for axes in shown] + [(axes.yaxis, "labelleft") for axes in shown]
    numbered = [axis for axis, side in sides if axis.get_tick_params().get(side, True)]
    return [axis.get_label().get_text() for axis in numbered]


def entries(legend):
    return [text.get_text() for text in legend.get_texts()]


def clouds(axes):
    """Dots of a panel, an array (n, 2) a branch."""
    return [line.get_xydata() for line in axes.lines if line.get_marker() == "o" and line.get_linestyle() == "None"]


def drawn(figure):
    figure.canvas.draw()
    return figure


@pytest.fixture(scope="module")
def single():
    return one_parameter()


@pytest.fixture(scope="module")
def hysteresis():
    return there_and_back()


@pytest.fixture(scope="module")
def grid():
    return two_parameters()


@pytest.fixture(scope="module")
def points():
    return scattered()


# --- every picture -------------------------------------------------------------------------------------------------


def test_every_axis_has_a_quantity_and_a_unit(single, hysteresis, grid, points):
    figures = [
        bifurcation_diagram(single),
        bifurcation_diagram(hysteresis),
        impact_diagram(hysteresis),
        basin_map(basins()),
        branch_diagram([followed()], "beam", hysteresis),
    ]
    for figure in figures:
        shown = labels(drawn(figure))
        assert shown
        assert all(label.endswith("]") and "[" in label for label in shown)
    for figure in (kind_map(grid), kind_map(points)):
        kinds, exponent, colours = drawn(figure).axes
        assert (kinds.get_xlabel(), kinds.get_ylabel()) == ("gain [1]", "offset [mm]")
        assert exponent.get_xlabel() == "gain [1]"
        assert colours.get_ylabel() == "Largest Lyapunov exponent [1/period]"


def test_the_title_names_model_and_phase(single, grid):
    for figure in (
        bifurcation_diagram(single),
        kind_map(grid),
        basin_map(basins()),
        branch_diagram([followed()], "beam"),
    ):
        assert figure.get_suptitle() == "cubic map, stroboscopic section at phase 0.25 of the excitation period"


def test_pictures_are_drawn_where_every_run_failed(single, hysteresis, grid, points):
    for sweep in (single, hysteresis):
        figure = drawn(bifurcation_diagram(all_failed(sweep)))
        assert sum(len(cloud) for axes in figure.axes for cloud in clouds(axes)) == 0
        assert entries(figure.axes[-1].get_legend()) == ["failed"]
        assert impact_diagram(all_failed(sweep)) is None
    for sweep in (grid, points):
        assert entries(drawn(kind_map(all_failed(sweep))).legends[0]) == ["failed"]
    panels = drawn(sections(all_failed(single.isel(drive_gain=[0, 1])))).axes
    assert len(panels) == 4  # of two bodies at two values
    assert all(axes.get_title(loc="left").endswith("failed") and not len(clouds(axes)[0]) for axes in panels)


def test_pictures_know_one_value(single, grid):
    drawn(bifurcation_diagram(single.isel(drive_gain=[3])))
    drawn(kind_map(grid.isel(gain=[2])))
    assert len(drawn(sections(single.isel(drive_gain=[3]))).axes) == 2


@pytest.mark.parametrize("picture", [bifurcation_diagram, impact_diagram])
def test_of_two_parameters_no_diagram_is_drawn(grid, picture):
    with pytest.raises(CalibError, match="has one parameter, but this sweep has 2: gain, offset"):
        picture(grid)


def test_of_one_parameter_no_map_is_drawn(single):
    with pytest.raises(CalibError, match="has two parameters, but this sweep has 1: drive_gain"):
        kind_map(single)


# --- over one parameter --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["single", "hysteresis"])
def test_each_finite_section_point_is_drawn_and_nothing_else(name, request):
    sweep = request.getfixturevalue(name)
    figure = bifurcation_diagram(sweep)
    assert sweep.sizes["body"] == 2
    for body, axes in zip(sweep.body.values, figure.axes[:2], strict=True):
        values = sweep.displacement.sel(body=body).values
        got = np.concatenate(clouds(axes))
        assert np.isfinite(values).sum() < values.size
        np.testing.assert_allclose(np.sort(got[:, 1]), np.sort(1e3 * values[np.isfinite(values)]))


def test_a_point_stands_over_its_value_of_the_parameter(hysteresis):
    axes = bifurcation_diagram(hysteresis, ["layer"]).axes[0]
    for name, cloud in zip(("forward", "backward"), clouds(axes), strict=True):
        for place in (20, 37):
            run = hysteresis.sel(branch=name, body="layer").isel(offset=place)
            here = np.isclose(cloud[:, 0], 1e3 * float(run.offset))
            np.testing.assert_allclose(np.sort(cloud[here, 1]), np.sort(1e3 * run.displacement.values))


def test_branches_differ_in_colour_and_size_and_are_in_the_legend(hysteresis):
    axes = bifurcation_diagram(hysteresis).axes[0]
    forward, backward = (line for line in axes.lines if line.get_marker() == "o")
    assert forward.get_color() != backward.get_color()
    assert forward.get_markersize() > 1.5 * backward.get_markersize()
    assert forward.get_zorder() < backward.get_zorder()
    assert entries(axes.get_legend()) == ["forward", "backward"]


def test_a_sweep_without_branches_has_no_legend_of_them(single):
    assert bifurcation_diagram(single).axes[0].get_legend() is None


def test_several_starts_are_told_apart(single):
    figure = drawn(bifurcation_diagram(as_starts(single), ["beam"]))
    colours = [line.get_color() for line in figure.axes[0].lines if line.get_marker() == "o"]
    assert len(set(colours)) == 4
    assert entries(figure.axes[0].get_legend()) == ["start 1", "start 2", "start 3", "start 4"]


def test_only_the_bodies_asked_for_have_a_panel(single):
    assert [axes.get_ylabel() for axes in bifurcation_diagram(single, ["layer"]).axes] == [
        "layer\ndisplacement [mm]",
        "Largest Lyapunov\nexponent [1/period]",
    ]
    with pytest.raises(CalibError, match=r"there is no body 'laier' here \(did you mean 'layer'\?\)"):
        bifurcation_diagram(single, ["laier"])


def test_exponents_have_the_colour_of_their_kind(single):
    axes = bifurcation_diagram(single).axes[-1]
    dots = {line.get_color(): line.get_xydata() for line in axes.lines if line.get_marker() == "o"}
    chaotic = single.exponent[single.kind == "chaotic"].values
    np.testing.assert_allclose(dots[KIND_COLOURS["chaotic"]][:, 1], chaotic)
    assert (dots[KIND_COLOURS["periodic"]][:, 1] <= 0.0).all()
    assert KIND_COLOURS["failed"] not in dots
    assert entries(axes.get_legend())[:2] == ["periodic", "chaotic"]


def test_exponents_below_the_axis_are_marked_at_its_bottom(single):
    exponent = single.exponent.copy()
    exponent[[2, 5]] = -np.inf
    sweep = single.assign(exponent=exponent)
    axes = drawn(bifurcation_diagram(sweep)).axes[-1]
    (marks,) = (line.get_xydata() for line in axes.lines if line.get_marker() == "v")
    assert {float(sweep.drive_gain[2]), float(sweep.drive_gain[5])} <= set(marks[:, 0])
    assert (marks[:, 1] == axes.get_ylim()[0]).all()
    dots = sum(len(cloud) for cloud in clouds(axes))
    assert dots + len(marks) == (sweep.kind != "failed").sum()
    assert entries(axes.get_legend())[-1] == "below the axis"


def test_wide_stretches_of_one_motion_are_named(single):
    texts = [text.get_text() for text in bifurcation_diagram(single).axes[0].texts]
    assert texts[:2] == ["1/1", "1/2"]
    assert texts[-1] == "impacts/periods\nof the motion"


def test_periods_stand_alone_where_impacts_are_not_told(single):
    texts = [
        text.get_text() for text in bifurcation_diagram(single.assign(impacts=0 * single.impacts - 1)).axes[0].texts
    ]
    assert texts[:2] == ["1", "2"]
    assert texts[-1] == "periods\nof the motion"


def test_failed_runs_are_marked_where_they_are(single):
    edges = swept(single.drive_gain).edges()
    failed = np.flatnonzero(single.kind.values == "failed")
    assert failed.size
    panels = bifurcation_diagram(single).axes
    assert panels
    for axes in panels:
        spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches]
        covered = [any(a <= x <= b for a, b in spans) for x in single.drive_gain.values]
        assert np.flatnonzero(covered).tolist() == failed.tolist()
        assert spans[-1][1] == pytest.approx(edges[-1])


def test_a_sweep_run_backwards_gives_the_same_picture(single):
    first, second = bifurcation_diagram(single), bifurcation_diagram(single.isel(drive_gain=slice(None, None, -1)))
    for one, other in zip(first.axes, second.axes, strict=True):
        np.testing.assert_allclose(np.concatenate(clouds(one)), np.concatenate(clouds(other)))


def test_impacts_are_drawn_by_phase_and_speed(hysteresis):
    phase, speed = drawn(impact_diagram(hysteresis)).axes
    for axes, name in ((phase, "impact_phase"), (speed, "impact_speed")):
        values = hysteresis[name].values
        np.testing.assert_allclose(np.sort(np.concatenate(clouds(axes))[:, 1]), np.sort(values[np.isfinite(values)]))
    assert phase.get_ylabel() == "Impact phase [periods]"
    assert phase.get_ylim() == (0.0, 1.0)
    assert entries(phase.get_legend()) == ["forward", "backward"]


def test_without_impacts_there_is_no_impact_diagram(single):
    assert impact_diagram(single.isel(impact=slice(0, 0))) is None


# --- the axis of a parameter ---------------------------------------------------------------------------------------


STRETCHES = (np.arange(50) + 0.5) / 50


@pytest.mark.parametrize(
    "even",
    [*(np.random.default_rng(seed).permutation(STRETCHES) for seed in (0, 1)), np.linspace(0.0, 1.0, 50)],
    ids=["drawn", "drawn otherwise", "grid"],
)
def test_the_axis_has_the_scale_on_which_values_are_even(even):
    assert swept(coordinate("point", 10.0 ** (3.0 * even), "stiffness", "N/m")).ratio
    assert not swept(coordinate("point", 1.0 + 1000.0 * even, "stiffness", "N/m")).ratio


def test_a_logarithmic_parameter_has_cells_of_equal_ratio(single):
    values = np.geomspace(1e-1, 1e3, single.sizes["drive_gain"])
    sweep = single.assign_coords(drive_gain=coordinate("drive_gain", values, "damping", "N s/m"))
    edges = swept(sweep.drive_gain).edges()
    np.testing.assert_allclose(edges[1:] / edges[:-1], values[1] / values[0])
    axes = drawn(bifurcation_diagram(sweep)).axes[-1]
    assert axes.get_xscale() == "log"
    assert axes.get_xlabel() == "damping [N s/m]"
    assert axes.get_xlim() == pytest.approx((edges[0], edges[-1]))


# --- over two parameters -------------------------------------------------------------------------------------------


def test_kinds_have_different_colours_and_their_order():
    distinct = {kind: colour for kind, colour in KIND_COLOURS.items() if kind != "periodic"}
    assert len(set(distinct.values())) == len(distinct)
    assert in_order(["failed", "chaotic", "period-2", "new", "period-2"]) == ["period-2", "chaotic", "failed", "new"]


def test_long_periods_are_taken_together():
    kinds = xr.DataArray(["period-4", "period-5", "period-8", "period-9", "chaotic"])
    assert binned_kind(kinds).tolist() == ["period-4", *["period-5 to 8"] * 2, "longer period", "chaotic"]
    assert plain_kind(kinds).tolist() == [*["periodic"] * 4, "chaotic"]


def test_a_cell_has_the_colour_of_its_kind_and_stands_at_its_place(grid):
    figure = drawn(kind_map(grid))
    (cells,) = figure.axes[0].collections
    colours = cells.to_rgba(cells.get_array())
    kinds = binned_kind(grid.kind)
    for i, j in ((0, 0), (12, 3), (20, 8), (23, 15)):
        expected = tuple(int(KIND_COLOURS[kinds[i, j]][k : k + 2], 16) / 255 for k in (1, 3, 5))
        np.testing.assert_allclose(colours[j, i, :3], expected)
        x, y = cells.get_coordinates()[j : j + 2, i : i + 2].reshape(-1, 2).mean(axis=0)
        assert (x, y) == pytest.approx((float(grid.gain[i]), 1e3 * float(grid.offset[j])))
    assert entries(figure.legends[0]) == in_order(kinds.ravel())


def test_the_colours_of_exponents_part_at_zero_and_failures_have_none(grid):
    exponent = grid.exponent.copy()
    exponent[0, 0] = -np.inf
    (cells,) = kind_map(grid.assign(exponent=exponent)).axes[1].collections
    low, high = cells.get_clim()
    assert low == -high
    assert cells.get_array()[0, 0] == low
    np.testing.assert_array_equal(np.ma.getmaskarray(cells.get_array()), (grid.kind == "failed").values.T)


def test_points_are_dots_and_failed_ones_crosses(points):
    figure = drawn(kind_map(points))
    failed = int((points.kind == "failed").sum())
    assert 0 < failed < points.sizes["point"]
    for axes in figure.axes[:2]:
        assert len(axes.collections[0].get_offsets()) == points.sizes["point"] - failed
        assert len(axes.lines[0].get_xydata()) == failed
    first = int(np.flatnonzero(points.kind.values != "failed")[0])
    place = (float(points.gain[first]), 1e3 * float(points.offset[first]))
    assert tuple(figure.axes[0].collections[0].get_offsets()[0]) == pytest.approx(place)


def test_each_branch_of_a_map_has_a_row(grid):
    both = xr.concat([grid, grid], dim="branch").assign_coords(branch=["forward", "backward"])
    titles = [axes.get_title(loc="left") for axes in drawn(kind_map(both)).axes]
    assert titles[:3] == ["forward: kind of motion", "forward: largest Lyapunov exponent", "backward: kind of motion"]


# --- planes of states ----------------------------------------------------------------------------------------------


def test_few_values_have_a_panel_each(single):
    few = single.isel(drive_gain=[0, 30, 45, 59])
    figure = drawn(sections(few))
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert len(panels) == 4 * 2
    by_title = {axes.get_title(loc="left"): axes for axes in panels if "layer" in axes.get_xlabel()}
    run = few.isel(drive_gain=1).sel(body="layer")
    (cloud,) = clouds(by_title[f"drive.gain = {float(run.drive_gain):.4g}\n{run.kind.item()}"])
    np.testing.assert_allclose(cloud, np.column_stack([1e3 * run.displacement, run.velocity]))
    assert panels[0].get_xlabel() == "Displacement of beam [mm]"
    assert panels[0].get_ylabel() == "Velocity [m/s]"


def test_many_values_have_no_panels(single, grid):
    assert sections(single) is None
    assert sections(single.isel(drive_gain=slice(0, 6))) is not None
    assert sections(single.isel(drive_gain=slice(0, 6)), max_panels=5) is None
    assert sections(grid.isel(gain=slice(0, 2), offset=slice(0, 4))) is None


def test_sections_know_two_parameters_points_and_branches(grid, points, hysteresis):
    figure = drawn(sections(grid.isel(gain=[0, 1], offset=[3, 4])))
    assert figure.axes[0].get_title(loc="left").splitlines()[0] == "gain = 0.5, offset = -0.3 mm"
    assert len(drawn(sections(points.isel(point=[0, 1]))).axes) == 4
    figure = drawn(sections(hysteresis.isel(offset=[20, 30])))
    assert entries(figure.legends[0]) == ["forward", "backward"]
    assert [len(clouds(axes)) for axes in figure.axes] == 4 * [2]  # of two bodies at two values


def test_basins_say_where_starts_end():
    figure = drawn(basin_map(basins()))
    (axes,) = figure.axes
    (cells,) = axes.collections
    np.testing.assert_array_equal(cells.get_array() == 2, basins().attractor.values == -1)
    shares = [float((basins().attractor == k).mean()) * 100 for k in (0, 1, -1)]
    named = [
        f"{name} ({share:.1f} %)" for name, share in zip(("0: period-2", "1: chaotic", "failed"), shares, strict=True)
    ]
    assert entries(figure.legends[0]) == [*named, "stroboscopic section"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("q3.displacement [mm]", "q3.velocity [m/s]")


def test_sections_of_attractors_lie_on_the_basins():
    axes = basin_map(basins()).axes[0]
    np.testing.assert_allclose(clouds(axes)[0], [[-1.0, -0.4], [-0.5, -0.2]])
    np.testing.assert_allclose(clouds(axes)[1], [[1.0, 0.4]])
    assert not clouds(basin_map(basins().drop_vars(["section_x", "section_y"])).axes[0])


# --- followed branches ---------------------------------------------------------------------------------------------


def test_stable_parts_are_solid_and_unstable_ones_dashed():
    branch = followed()
    upper = drawn(branch_diagram([branch], "beam")).axes[0]
    solid, dashed = upper.lines[:2]
    assert solid.get_linestyle() == "-"
    assert dashed.get_linestyle() == "--"
    height = 1e3 * branch.displacement.sel(body="beam").values[0]
    np.testing.assert_allclose(solid.get_ydata()[branch.stable], height[branch.stable])
    assert np.isnan(solid.get_ydata()[~branch.stable.values]).all()
    np.testing.assert_allclose(dashed.get_ydata()[~branch.stable.values], height[~branch.stable.values])


def test_a_branch_of_one_point_is_drawn():
    one, empty = followed().isel(step=[0]).drop_dims("special"), np.zeros(0)
    none = {"special_kind": empty.astype(str), "special_parameter": empty, "special_index": empty.astype(int)}
    none = {name: ("special", values) for name, values in none.items()}
    figure = drawn(branch_diagram([one.assign(none)], "beam"))
    assert len(figure.axes[0].lines[0].get_xdata()) == 1


def test_special_points_are_marked_and_named():
    branch = followed()
    figure = branch_diagram([branch], "layer")
    assert entries(figure.axes[0].get_legend()) == ["stable", "unstable", "fold", "grazing"]
    fold, grazing = figure.axes[0].lines[2:4]
    assert fold.get_marker() != grazing.get_marker()
    np.testing.assert_allclose(fold.get_xydata(), [[0.5, 0.0]], atol=1e-12)
    np.testing.assert_allclose(grazing.get_xydata(), [[0.1, 3.0]])


def test_multipliers_stand_beneath_with_the_unit_line():
    lower = branch_diagram([followed()], "beam").axes[1]
    *moduli, unit = lower.lines
    assert list(unit.get_ydata()) == [1.0, 1.0]
    np.testing.assert_allclose([line.get_ydata() for line in moduli], followed().multiplier_modulus)


def test_the_sweep_stands_behind_its_branch(hysteresis):
    figure = drawn(branch_diagram([followed()], "beam", hysteresis))
    behind = clouds(figure.axes[0])[-2:]
    values = hysteresis.displacement.sel(body="beam").values
    assert sum(len(cloud) for cloud in behind) == np.isfinite(values).sum()
    low, high = figure.axes[0].get_xlim()
    assert low < -0.9
    assert high > 0.9
    assert entries(figure.axes[0].get_legend())[-1] == "sweep"


def test_a_sweep_over_something_else_is_refused(single):
    with pytest.raises(CalibError, match=r"the branch follows 'offset', but the sweep is over 'drive\.gain'"):
        branch_diagram([followed()], "beam", single)
