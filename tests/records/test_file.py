import ctypes
import subprocess
import sys
import time
import warnings

import netCDF4
import numpy as np
import pytest

from calib.errors import CalibError
from calib.execution import netcdf
from calib.records import make, read, write

TIME = np.linspace(0.0, 0.1, 50)


def swing(**attrs):
    x = np.array([np.cos(60 * TIME), np.sin(60 * TIME)])
    attrs = {"frequency": 60 / (2 * np.pi), "amplitude": 1e-3, "place": "end", "quantity": "displacement", **attrs}
    return make(TIME, ["beam", "layer"], {"displacement": x, "velocity": 60 * x}, **attrs)


def test_a_record_comes_back_from_its_file_bit_by_bit(tmp_path):
    write(swing(), tmp_path / "r.nc")
    assert read(tmp_path / "r.nc").identical(swing())
    assert [p.name for p in tmp_path.iterdir()] == ["r.nc"]


def test_a_write_that_fails_leaves_the_old_file_alone(tmp_path):
    write(swing(), tmp_path / "r.nc")
    with pytest.raises(Exception, match="Invalid value for attr|not valid|NoneType"):
        write(swing(bad=None), tmp_path / "r.nc")
    assert read(tmp_path / "r.nc").identical(swing())
    assert [p.name for p in tmp_path.iterdir()] == ["r.nc"]


def test_what_reads_files_is_imported_once_not_in_each_process_that_is_forked_for_one(tmp_path):
    """In a process that has read none: xarray imports some 300 modules as it reads its first."""
    write(swing(), tmp_path / "r.nc")
    lines = [
        "import sys; from calib.execution import netcdf; from calib.records import read",
        "netcdf.apart_before = netcdf.read_apart",
        "def counted(call, path):",
        "    before = len(sys.modules); call(); print(len(sys.modules) - before)",
        "    return netcdf.apart_before(call, path)",
        "netcdf.read_apart = counted; read(sys.argv[1])",
    ]
    ran = subprocess.run(
        [sys.executable, "-c", "\n".join(lines), tmp_path / "r.nc"], capture_output=True, text=True, check=True
    )
    assert int(ran.stdout) < 20


def test_a_truncated_file_is_named(tmp_path):
    path = tmp_path / "r.nc"
    write(swing(), path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(CalibError, match=r"r\.nc: not a readable netCDF file"):
        read(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(CalibError, match=r"r\.nc: no such file"):
        read(tmp_path / "r.nc")


# ---- units


def rewritten(path, change):
    """Write the record of `swing` with its file changed by `change(file)`."""
    write(swing(), path)
    with netCDF4.Dataset(path, "a") as file:
        change(file)
    return path


@pytest.mark.parametrize(
    ("variable", "unit", "factor"),
    [
        ("time", "ms", 1e3),
        ("time", "min", 1 / 60),
        ("displacement", "mm", 1e3),
        ("displacement", "um", 1e6),
        ("velocity", "mm/s", 1e3),
        ("velocity", "m s^-1", 1.0),
    ],
)
def test_what_is_stated_in_another_unit_is_read_in_si(tmp_path, variable, unit, factor):
    def scale(file):
        file[variable][:] = file[variable][:] * factor
        file[variable].units = unit

    got = read(rewritten(tmp_path / "r.nc", scale))
    np.testing.assert_allclose(got[variable], swing()[variable], rtol=1e-14)
    assert got[variable].attrs["units"] == swing()[variable].attrs["units"]


def test_an_uncertainty_is_read_in_its_own_unit(tmp_path):
    def state(file):
        add(file, "displacement_sigma", "f8", ("body",), [0.002, 0.003], units="mm")
        add(file, "excitation", "f8", ("time",), TIME, units="mm")

    got = read(rewritten(tmp_path / "r.nc", state))
    np.testing.assert_allclose(got.displacement_sigma, [2e-6, 3e-6])
    np.testing.assert_allclose(got.excitation, 1e-3 * TIME)
    assert (got.displacement_sigma.attrs["units"], got.excitation.attrs["units"]) == ("m", "m")


def test_an_uncertainty_without_a_unit_has_that_of_its_channel(tmp_path):
    def state(file):
        file["displacement"][:] = file["displacement"][:] * 1e3
        file["displacement"].units = "mm"
        add(file, "displacement_sigma", "f8", ("body",), [0.002, 0.003])

    got = read(rewritten(tmp_path / "r.nc", state))
    np.testing.assert_allclose(got.displacement_sigma, [2e-6, 3e-6])


def test_integer_times_in_milliseconds_are_read_in_seconds(tmp_path):
    path = tmp_path / "r.nc"
    remade(path, time=("i4", np.arange(TIME.size), {"units": "ms"}))
    got = read(path).time.values
    assert got.dtype == np.float64
    np.testing.assert_allclose(got, 1e-3 * np.arange(TIME.size))


def test_a_channel_of_single_precision_is_read_as_doubles(tmp_path):
    remade(tmp_path / "r.nc", displacement=("f4", np.ones((2, TIME.size)), {"units": "m"}))
    assert read(tmp_path / "r.nc").displacement.dtype == np.float64


# ---- malformed files


def add(file, name, kind, dims, values, **attrs):
    variable = file.createVariable(name, kind, dims)
    variable[:] = values
    variable.setncatts(attrs)


def remade(path, **variables):
    """Write a record of two bodies, with variables as (type, values, attributes) in the place of the usual ones."""
    usual = {
        "body": (str, np.array(["beam", "layer"], dtype=object), {}),
        "time": ("f8", TIME, {"units": "s"}),
        "displacement": ("f8", np.ones((2, TIME.size)), {"units": "m"}),
    }
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("body", 2)
        file.createDimension("time", TIME.size)
        for name, (kind, values, attrs) in (usual | variables).items():
            dims = {"body": ("body",), "time": ("time",)}.get(name, ("body", "time"))
            add(file, name, kind(file) if callable(kind) and kind is not str else kind, dims, values, **attrs)
    return path


def variable(name, kind, values, unit="m"):
    return lambda path: remade(path, **{name: (kind, values, {"units": unit})})


def changed(change):
    return lambda path: rewritten(path, change)


def attribute(name, value, variable=None):
    def state(file):
        holder = file if variable is None else file[variable]
        holder.setncattr(name, value)

    return changed(state)


def added(name, dims, values, unit="m"):
    return changed(lambda file: add(file, name, "f8", dims, values, units=unit))


def complex_channel(path):
    number = np.dtype([("r", "f8"), ("i", "f8")])
    return remade(
        path,
        displacement=(
            lambda file: file.createCompoundType(number, "complex"),
            np.zeros((2, TIME.size), dtype=number),
            {"units": "m"},
        ),
    )


def enumerated_channel(path):
    kind = lambda file: file.createEnumType(np.int8, "state", {"open": 0, "closed": 1})  # noqa: E731
    return remade(path, displacement=(kind, np.zeros((2, TIME.size), dtype=np.int8), {"units": "m"}))


def ragged_channel(path):
    rows = np.empty((2, TIME.size), dtype=object)
    for index in np.ndindex(rows.shape):
        rows[index] = np.ones(2)
    return remade(path, displacement=(lambda file: file.createVLType(np.float64, "ragged"), rows, {"units": "m"}))


def bool_channel(path):
    return remade(path, displacement=("i1", np.ones((2, TIME.size)), {"units": "m", "dtype": "bool"}))


def nested_attribute(path):
    def state(file):
        inner = np.dtype([("low", "f8"), ("high", "f8")])
        file.createCompoundType(inner, "window")
        file.setncattr("frequency", np.array((1.0, 2.0), dtype=inner))

    return rewritten(path, state)


def giant(path):
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("body", 1)
        file.createDimension("time", 10**10)
        add_declared(file, "time", "f8", ("time",), "s")
        add_declared(file, "displacement", "f4", ("body", "time"), "m")
    return path


def giant_chunk(path):
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("body", 1)
        file.createDimension("time", None)
        chunk = file.createVariable("displacement", "f8", ("body", "time"), chunksizes=(1, 2**28), zlib=True)
        chunk.units = "m"
    return path


def add_declared(file, name, kind, dims, unit):
    file.createVariable(name, kind, dims, chunksizes=[1] * (len(dims) - 1) + [1000]).units = unit


def grouped(path):
    return rewritten(path, lambda file: file.createGroup("inner"))


WHOLE = np.ones((2, TIME.size))
TEXT = np.full((2, TIME.size), "1.0", dtype=object)
MALFORMED = {
    "complex channel": (complex_channel, "displacement: expected real numbers or text, got (a compound|complex)"),
    "enumerated channel": (enumerated_channel, "displacement: expected real numbers or text, got an enumeration"),
    "ragged channel": (ragged_channel, "displacement: expected real numbers or text, got a variable-length type"),
    "text channel": (variable("displacement", str, TEXT), r"displacement: expected real numbers \[m\], got text"),
    "bool channel": (bool_channel, r"displacement: expected real numbers \[m\], got truth values"),
    "channel without bodies": (added("force", ("time",), TIME, "N"), r"expected force with dims \('body', 'time'\)"),
    "infinite channel": (variable("displacement", "f8", np.inf * WHOLE), "is not a number at sample 0"),
    "channel of 1e300": (variable("displacement", "f8", 1e300 * WHOLE), r"is too large \(1e\+300\) at sample 0"),
    "text times": (variable("time", str, TEXT[0], "s"), r"time: expected real numbers \[s\], got text"),
    "repeated integer times": (variable("time", "i8", np.zeros(TIME.size), "s"), "time must increase"),
    "falling unsigned times": (variable("time", "u4", np.arange(TIME.size)[::-1], "s"), "time must increase"),
    "huge times": (variable("time", "f8", 1e300 * (1 + TIME), "s"), "time: expected at most 1e\\+09 s"),
    "huge integer times": (variable("time", "i8", 10**17 + np.arange(TIME.size), "s"), "time: expected at most"),
    "tiny times": (variable("time", "f8", 1e-300 * (1 + TIME), "s"), "time: expected at least 1e-15 s between"),
    "dates": (variable("time", "f8", TIME, "days since 2000-01-01"), "time is expected in 's'"),
    "times in metres": (attribute("units", "m", "time"), "time is expected in 's' or a unit of its dimension, got 'm'"),
    "times without unit": (changed(lambda file: file["time"].delncattr("units")), "time states no unit"),
    "unit that is a number": (attribute("units", 3.0, "time"), "attribute units: expected a unit such as 's'"),
    "unit that takes for ever": (attribute("units", "9**9**9 m", "displacement"), "expected a unit such as 'm'"),
    "unit that is long": (attribute("units", "m" * 1000, "displacement"), "expected a unit such as 'm'"),
    "sigma in volts": (added("velocity_sigma", ("body",), 1.0, "V"), "velocity_sigma is expected in 'm/s'"),
    "sigma over time": (
        added("velocity_sigma", ("time",), 1.0, "m/s"),
        r"velocity_sigma with dims \('body',\) or",
    ),
    "scalar sigma": (added("velocity_sigma", (), 1.0, "m/s"), r"expected velocity_sigma with dims .*, got \(\)"),
    "infinite sigma": (added("velocity_sigma", ("body",), np.inf, "m/s"), "velocity_sigma must be positive and finite"),
    "channel of its own in milli": (added("strain", ("body", "time"), 1.0, "mm/m"), "strain is none of"),
    "excitation in volts": (added("excitation", ("time",), 1.0, "V"), "excitation is expected in 'm'"),
    "excitation of NaN": (added("excitation", ("time",), np.nan), "excitation: expected finite numbers"),
    "integer bodies": (variable("body", "i4", [1, 2]), "body: expected names that are texts, such as 'beam', got 1"),
    "duplicate bodies": (
        variable("body", str, np.array(["beam", "beam"], dtype=object)),
        "body: expected each name once, got 'beam' 2 times",
    ),
    "nameless body": (variable("body", str, np.array(["beam", ""], dtype=object)), "expected names that are texts"),
    "frequency NaN": (attribute("frequency", np.nan), "attribute frequency: expected a number in SI"),
    "frequency infinite": (attribute("frequency", np.inf), "attribute frequency: expected a number in SI"),
    "frequency 1e300": (attribute("frequency", 1e300), "attribute frequency: expected a number in SI"),
    "frequency 1e20": (attribute("frequency", 1e20), "attribute frequency: expected a number in SI"),
    "frequency zero": (attribute("frequency", 0.0), "attribute frequency: expected a number in SI"),
    "frequencies": (attribute("frequency", [26.0, 27.0]), "attribute frequency: expected a number in SI"),
    "amplitude NaN": (attribute("amplitude", np.nan), "attribute amplitude: expected a finite number"),
    "phase as text": (attribute("phase", "90 deg"), "attribute phase: expected a finite number"),
    "numbers for a place": (attribute("place", [1.0, 2.0]), "attribute place: expected a text"),
    "number for a quantity": (attribute("quantity", 7), "attribute quantity: expected a text"),
    "nested attribute": (nested_attribute, "attribute frequency: expected a (number|text)"),
    "nested nuisances": (attribute("nuisance_sigma", "[" * 20000), "attribute nuisance_sigma: expected a JSON object"),
    "nuisances in nuisances": (attribute("nuisance_sigma", '{"shear": {"x": 1}}'), "nuisance_sigma: expected a JSON"),
    "infinite nuisance": (attribute("nuisance_sigma", '{"shear": 1e999}'), "nuisance_sigma: expected a JSON object"),
    "diverged": (attribute("status", "diverged"), "attribute status: expected 'ok', got 'diverged'"),
    "status that is a number": (attribute("status", 1), "attribute status: expected 'ok'"),
    "giant": (giant, r"displacement: expected at most 1 GiB in all variables|time: expected at most 1 GiB"),
    "giant chunk": (giant_chunk, "displacement: expected at most 1 GiB in all variables"),
    "group": (grouped, "inner: expected variables only, got a group"),
    "folder": (lambda path: path.mkdir(), "expected a netCDF file, got a folder"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_a_malformed_file_is_refused_with_its_name_variable_and_remedy(tmp_path, case):
    make_file, said = MALFORMED[case]
    path = tmp_path / "r.nc"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of netCDF4, while it writes what nobody should
        make_file(path)
    begin = time.perf_counter()
    with pytest.raises(CalibError, match=said) as refused:
        read(path)
    assert str(path) in str(refused.value)
    assert time.perf_counter() - begin < 5.0  # s


def test_the_bound_is_for_all_variables_together(tmp_path, monkeypatch):
    write(swing(), tmp_path / "r.nc")
    monkeypatch.setattr(netcdf, "MAX_DATASET_BYTES", 2 * 2 * 8 * TIME.size)
    with pytest.raises(CalibError, match="GiB in all variables"):
        read(tmp_path / "r.nc")


def test_a_file_of_netcdf_3_is_read(tmp_path):
    swing().to_netcdf(tmp_path / "r.nc", format="NETCDF3_64BIT")
    assert read(tmp_path / "r.nc").displacement.equals(swing().displacement)


# ---- data in other files


@pytest.fixture
def hdf5():
    library = ctypes.CDLL(netCDF4._netCDF4.__file__)
    for name in ("H5Fopen", "H5Screate_simple", "H5Pcreate", "H5Dcreate2"):
        getattr(library, name).restype = ctypes.c_int64
    library.H5open()
    return library


def handle(number):
    return ctypes.c_int64(number)


def linked(library, file, kind):
    """Add a link `force` of a kind to an open file."""
    if kind == "external":
        return library.H5Lcreate_external(b"other.nc", b"/displacement", file, b"force", handle(0), handle(0))
    return library.H5Lcreate_soft(b"/displacement", file, b"force", handle(0), handle(0))


def stored(library, file, kind, folder):
    """Add a dataset `force` whose values lie elsewhere to an open file."""
    space = handle(library.H5Screate_simple(2, (ctypes.c_uint64 * 2)(2, TIME.size), None))
    creation = handle(library.H5Pcreate(handle(ctypes.c_int64.in_dll(library, "H5P_CLS_DATASET_CREATE_ID_g").value)))
    if kind == "virtual":
        done = library.H5Pset_virtual(creation, space, b"other.nc", b"/displacement", space)
    else:
        (folder / "raw.bin").write_bytes(np.ones((2, TIME.size)).tobytes())
        size = ctypes.c_uint64(2 * TIME.size * 8)
        done = library.H5Pset_external(creation, str(folder / "raw.bin").encode(), ctypes.c_int64(0), size)
    double = handle(ctypes.c_int64.in_dll(library, "H5T_IEEE_F64LE_g").value)
    dataset = handle(library.H5Dcreate2(file, b"force", double, space, handle(0), creation, handle(0)))
    library.H5Dclose(dataset)
    library.H5Pclose(creation)
    library.H5Sclose(space)
    return done


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("external", "got an external link"),
        ("soft", "got a soft link"),
        ("virtual", "got a virtual dataset"),
        ("raw", "got external storage"),
    ],
)
def test_data_in_other_files_are_refused(tmp_path, hdf5, kind, said):
    write(swing(), tmp_path / "other.nc")
    write(swing(), tmp_path / "r.nc")
    file = handle(hdf5.H5Fopen(str(tmp_path / "r.nc").encode(), ctypes.c_uint(1), handle(0)))
    done = linked(hdf5, file, kind) if kind in ("external", "soft") else stored(hdf5, file, kind, tmp_path)
    hdf5.H5Fclose(file)
    assert done >= 0
    with pytest.raises(CalibError, match=rf"r\.nc: force: expected data in the file itself, {said}"):
        read(tmp_path / "r.nc")


def test_a_link_to_nowhere_is_refused_without_looking_for_it(tmp_path, hdf5):
    write(swing(), tmp_path / "r.nc")
    file = handle(hdf5.H5Fopen(str(tmp_path / "r.nc").encode(), ctypes.c_uint(1), handle(0)))
    linked(hdf5, file, "external")
    hdf5.H5Fclose(file)
    with pytest.raises(CalibError, match="got an external link"):
        read(tmp_path / "r.nc")
