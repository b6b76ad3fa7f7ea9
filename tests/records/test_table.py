"""Measured tables as records."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import savemat

from calib.errors import CalibError
from calib.records.delimited import TextLayout
from calib.records.table import Channel, ExcitationColumn, Table, TimeColumn, read

HEADED = "t,x,u,note,\n0.0,1.0,10,a,\n0.1,2.0,20,,\n0.2,3.0,30,b,\n0.3,4.0,40,c,\n0.4,5.0,50,d,\n"
X = Channel("x", "mass", "displacement", "mm")
U = ExcitationColumn("u", "mass", "force", "V", "2 N/V")


@pytest.fixture
def headed(tmp_path):
    path = tmp_path / "headed.csv"
    path.write_text(HEADED)
    return path


def test_columns_become_channels_in_si_and_the_excitation(headed):
    record, excitation = read(Table(headed, [X], U, time=TimeColumn("t")))
    np.testing.assert_allclose(record.displacement.sel(body="mass"), [1e-3, 2e-3, 3e-3, 4e-3, 5e-3], rtol=1e-15)
    np.testing.assert_allclose(record.time, [0.0, 0.1, 0.2, 0.3, 0.4], rtol=1e-15)
    np.testing.assert_allclose(excitation.value, [20.0, 40.0, 60.0, 80.0, 100.0], rtol=1e-15)
    assert (excitation.place, excitation.quantity, excitation.unit) == ("mass", "force", "N")
    np.testing.assert_array_equal(record.excitation, excitation.value)


@pytest.mark.parametrize(("unit", "scale"), [("g", 1.0), ("g", "9.80665 m/s^2/g"), ("V", "1 g/V"), ("m/s^2", 9.80665)])
def test_g_of_an_acceleration_is_that_of_gravity(headed, unit, scale):
    record, _ = read(Table(headed, [Channel("x", "mass", "acceleration", unit, scale, sigma="1 mg")], rate=10.0))
    np.testing.assert_allclose(record.acceleration[0], 9.80665 * np.arange(1.0, 6.0), rtol=1e-15)
    np.testing.assert_allclose(record.acceleration_sigma, 9.80665e-3, rtol=1e-15)
    assert record.acceleration.attrs["units"] == "m/s^2"


def test_a_slice_starts_at_time_zero_and_the_excitation_keeps_the_margin(headed):
    record, excitation = read(Table(headed, [X], U, time=TimeColumn("t"), first=2, last=4, margin=1))
    np.testing.assert_allclose(record.time, [0.0, 0.1], atol=1e-15)
    np.testing.assert_allclose(record.displacement[0], [3e-3, 4e-3])
    np.testing.assert_allclose(excitation.time, [-0.1, 0.0, 0.1, 0.2], atol=1e-15)


def test_a_margin_ends_where_the_file_ends(headed):
    _, excitation = read(Table(headed, [X], U, rate=10.0, first=1, last=3, margin=99))
    np.testing.assert_allclose(excitation.time, [-0.1, 0.0, 0.1, 0.2, 0.3], atol=1e-15)


def test_decimation_thins_the_channels_but_not_the_excitation(headed):
    record, excitation = read(Table(headed, [X], U, rate=10.0, decimate=2))
    np.testing.assert_allclose(record.time, [0.0, 0.2, 0.4])
    assert excitation.time.size == 5


@pytest.mark.parametrize(
    "text", ["1 2\n3 4\n5 6\n", "1\t2\n3\t4\n5\t6\n", "# by hand\n1;2\n\n3;4\n5;6\n", "  1   2\n 3  4 \n 5 6\n"]
)
def test_a_file_without_header_is_read_by_position(tmp_path, text):
    path = tmp_path / "bare.txt"
    path.write_text(text)
    record, _ = read(Table(path, [Channel(2, "mass", "velocity", "m/s")], time=TimeColumn(1, "ms")))
    np.testing.assert_allclose(record.velocity[0], [2.0, 4.0, 6.0])
    np.testing.assert_allclose(record.time, [0.0, 2e-3, 4e-3])


LOGGED = (
    "Versuch 3;Prüfstand A\nZeit [s];Weg [µm]\ns;mm\n0,000000;1,5\n0,1;2,5D+00\n0,2;-3,5\n"  # as a data logger writes
)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8", "utf-16"])
def test_text_is_read_as_its_layout_says(tmp_path, encoding):
    path = tmp_path / "logged.csv"
    path.write_bytes(LOGGED.replace("\n", "\r\n").encode(encoding))
    layout = TextLayout(decimal=",", skip=1, header=2, encoding=encoding)
    channels = [Channel("Weg [µm]", "mass", "displacement", "mm")]
    record, _ = read(Table(path, channels, time=TimeColumn("Zeit [s]"), text=layout))
    np.testing.assert_allclose(record.displacement[0], [1.5e-3, 2.5e-3, -3.5e-3], rtol=1e-15)
    np.testing.assert_allclose(record.time, [0.0, 0.1, 0.2], rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        # the classic CSV of Tektronix: what was set stands beside the first samples
        (
            "Record Length,5,,-0.002,0.1\nSample Interval,0.001,,-0.001,0.2\nTrigger Point,2,,0,0.3\n,,,0.001,0.4\n",
            "line 1: .* got both, 'Record Length' and '5'; state header = 0 where the row is a sample, header = 1 wh",
        ),
        ("0,OVER\n1,2\n2,3\n", "line 1: .* 'OVER' and '0'; state header = 0"),
        ("0;#N/A\n1;2\n2;3\n", "line 1: .* '#N/A' and '0'; state header = 0"),
        ("0,begins,1\n0.5,ends,3\n", "line 1: .* 'begins' and '0'; state header = 0"),
        ("t,1,2\n0,1,2\n1,2,3\n", "line 1: .* 't' and '1'; .* header = 1 where it names the columns"),
        ("0;1,5\n1;1,6\n", "line 1: .* '1,5' and '0'; if it is a decimal comma, set decimal = ','; else state header"),
    ],
)
def test_a_first_row_of_names_and_numbers_is_refused_until_it_is_stated(tmp_path, text, says):
    mistake(tmp_path / "scope.csv", says, text, [replace(X, column=1)])


def test_a_first_row_that_is_stated_is_no_header_or_one(tmp_path):
    path = tmp_path / "scope.csv"
    path.write_text("Record Length,5,,-0.002,0.1\nSample Interval,0.001,,-0.001,0.2\nTrigger Point,2,,0,0.3\n")
    record, _ = read(Table(path, [replace(X, column=5)], time=TimeColumn(4), text=TextLayout(header=0)))
    np.testing.assert_allclose(record.displacement[0], [1e-4, 2e-4, 3e-4])
    path.write_text("t,1\n0,3\n1,4\n")
    record, _ = read(Table(path, [replace(X, column="1")], time=TimeColumn("t"), text=TextLayout(header=1)))
    np.testing.assert_allclose(record.displacement[0], [3e-3, 4e-3])
    mistake(path, "line 1: .* got 'OVER'; `first` and", "0,OVER\n1,2\n", [replace(X, column=2)], layout={"header": 0})


def test_the_minus_sign_of_a_word_processor_is_read(tmp_path):
    path = tmp_path / "minus.csv"
    path.write_text("0,\u22121\n1,2\n2,\u22123e\u22121\n")
    record, _ = read(Table(path, [replace(X, column=2)], time=TimeColumn(1)))
    np.testing.assert_allclose(record.displacement[0], [-1e-3, 2e-3, -3e-4])


@pytest.mark.parametrize(
    ("text", "layout", "says"),
    [
        (
            "0;1.234\n1;1.235\n",
            {"decimal": ","},
            "line 1: .* column 2, got '1.234'; with decimal = ',' a point may sep",
        ),
        ("t;x\n0;999,5\n1;1.000\n", {"decimal": ","}, "line 3: .* column 2, got '1.000'; with decimal = ','"),
        ("0;1,5\n1;1.000,5\n", {"decimal": ","}, "line 2: .* got '1.000,5'; write it without points between the thous"),
        (
            "t;x\n0;1,234\n",
            {},
            "got '1,234'; if it is a decimal comma, .*; if it separates thousands, write the number",
        ),
        ("t;x\n0;1,234.5\n", {}, "got '1,234.5'; write it without commas between the thousands"),
    ],
)
def test_a_number_whose_thousands_may_be_separated_is_refused(tmp_path, text, layout, says):
    mistake(tmp_path / "counts.csv", says, text, [replace(X, column=2)], layout=layout)


@pytest.mark.parametrize("layout", [{"decimal": ","}, {"separator": ","}])
def test_one_column_with_a_decimal_comma_is_not_two_columns_of_integers(tmp_path, layout):
    text = "1,5\n1,6\n1,7\n"
    mistake(
        tmp_path / "one.csv", "line 1: '1,5' may be .*; state decimal = ',' or separator", text, [replace(X, column=1)]
    )
    table = Table(tmp_path / "one.csv", [replace(X, column=1)], rate=1000.0, text=TextLayout(**layout))
    expected = [1.5e-3, 1.6e-3, 1.7e-3] if "decimal" in layout else [1e-3] * 3
    np.testing.assert_allclose(read(table)[0].displacement[0], expected)


def test_integers_beside_a_rising_column_are_two_columns(tmp_path):
    (tmp_path / "counts.csv").write_text("10,512\n11,498\n12,505\n")
    record, _ = read(Table(tmp_path / "counts.csv", [replace(X, column=2)], time=TimeColumn(1, "ms")))
    np.testing.assert_allclose(record.displacement[0], [0.512, 0.498, 0.505])


@pytest.mark.parametrize(
    "text",
    [
        "sep=;\nt;x\n0;1\n1;2\n",  # as Excel writes it
        '"sep=|"\nt|x\n0|1\n1|2\n',
        "# run 3\n#\n# t x\n0 1\n1 2\n",  # as numpy.savetxt writes it
        "# t, x\n0,1\n1,2\n",
        "# t x\n0,1\n1,2\n",
        "% t x\n% s mm\n0 1\n1 2\n",
        "t,x\n0,1,\n1,2,\n",
        "t\tx\n0\t1\t\n1\t2\t\n",
    ],
)
def test_what_programs_write_around_the_numbers_is_read(tmp_path, text):
    path = tmp_path / "written.csv"
    path.write_text(text)
    record, _ = read(Table(path, [X], time=TimeColumn("t")))
    np.testing.assert_allclose(record.time, [0.0, 1.0])
    np.testing.assert_allclose(record.displacement[0], [1e-3, 2e-3])


@pytest.mark.parametrize("comment", ["# by hand, 3 mm", "# 1 2", "# run", "# t x\n"])
def test_a_comment_that_is_not_one_word_a_column_names_none(tmp_path, comment):
    mistake(tmp_path / "bare.txt", "no header, only columns 1 to 2", f"{comment}\n0 1\n1 2\n", [X])


def test_repeated_instants_of_too_few_digits_are_answered_with_the_rate(tmp_path):
    """50 kHz in six digits: five samples have one time, and dropping four of them would make it 10 kHz."""
    text = "".join(f"{10.0 + i / 50e3:.5e},{i}\n" for i in range(400))
    options = {"channels": [replace(X, column=2)], "rate": None, "time": TimeColumn(1)}
    mistake(
        tmp_path / "digits.csv", 'state the sampling rate .*rate = "2 kHz" .*drop samples only that', text, **options
    )
    mistake(tmp_path / "digits.csv", 'time that increases .*rate = "2 kHz"', text, cutoff=900.0, **options)
    gap = "0,1\n0.1,2\n0.1,3\n0.2,4\n9,4\n9.1,5\n"
    mistake(tmp_path / "gap.csv", "sort the samples and drop repeated ones", gap, **options)


def test_names_are_stated_for_text_without_a_header(tmp_path, headed):
    path = tmp_path / "bare.txt"
    path.write_text("% by hand\n0 1\n0.1 2\n")
    record, _ = read(Table(path, [X], time=TimeColumn("t"), text=TextLayout(comment="%", names=["t", "x"])))
    np.testing.assert_allclose(record.displacement[0], [1e-3, 2e-3])


@pytest.mark.parametrize(
    ("says", "layout"),
    [
        (r"not a text file in UTF-8 .*; state its encoding, such as encoding = \"latin-1\"", {}),
        ("unknown encoding 'latin1-x'", {"encoding": "latin1-x"}),
        ("unknown encoding 'rot13'", {"encoding": "rot13"}),
        (
            "line 3: expected a number in column 'Zeit .s.', got 's'; if a row of units follows the names, set header",
            {"encoding": "latin-1", "skip": 1, "decimal": ","},
        ),
        (
            "line 4: .* in column 'Zeit .s.', got '0,000000'; if it is a decimal comma, set decimal = ','",
            {"encoding": "latin-1", "skip": 1, "header": 2},
        ),
        ("separator and decimal are both ','", {"encoding": "latin-1", "decimal": ",", "separator": ","}),
    ],
)
def test_text_of_another_layout_is_answered(tmp_path, says, layout):
    path = tmp_path / "logged.csv"
    path.write_bytes(LOGGED.encode("latin-1"))
    channels = [Channel("Weg [µm]", "mass", "displacement", "mm")]
    with pytest.raises(CalibError, match=says):
        read(Table(path, channels, time=TimeColumn("Zeit [s]"), text=TextLayout(**layout)))


def test_a_title_above_the_header_is_left_out_by_skip(tmp_path):
    mistake(
        tmp_path / "table.csv", "line 2: expected 2 cells as in line 1, got 1; .*left out by `skip`", "Run 3\n" + HEADED
    )


def test_a_layout_of_what_is_no_text_is_refused(tmp_path):
    (tmp_path / "table.json").write_text("[[0, 1], [1, 2]]")
    with pytest.raises(CalibError, match="decimal, skip can be stated of delimited text only"):
        read(Table(tmp_path / "table.json", [X], rate=1.0, text=TextLayout(decimal=",", skip=1)))


def test_a_matlab_file_gives_the_same_record(tmp_path, headed):
    numbers = np.genfromtxt(headed, delimiter=",", skip_header=1, usecols=(0, 1, 2))
    path = tmp_path / "same.mat"
    savemat(path, {"t": numbers[:, :1], "x": numbers[:, 1:2], "u": numbers[:, 2:], "gain": 3.0, "label": "by hand"})
    text, matlab = (read(Table(p, [X], U, time=TimeColumn("t")))[0] for p in (headed, path))
    np.testing.assert_array_equal(text.displacement, matlab.displacement)
    np.testing.assert_array_equal(text.excitation, matlab.excitation)


@pytest.mark.parametrize("whole", ["%s", '{"dt": 0.1, "data": %s, "units": ["s", "mm", "V"]}'])
def test_a_json_list_of_rows_is_read_by_position(tmp_path, headed, whole):
    path = tmp_path / "same.json"
    path.write_text(whole % "[[0.0, 1, 10], [0.1, 2.0, 20], [0.2, 3, 30], [0.3, 4, 40], [0.4, 5, 50]]")
    by_position = replace(X, column=2), replace(U, column=3)
    found, _ = read(Table(path, [by_position[0]], by_position[1], time=TimeColumn(1)))
    text, _ = read(Table(headed, [X], U, time=TimeColumn("t")))
    np.testing.assert_array_equal(found.displacement, text.displacement)
    np.testing.assert_array_equal(found.excitation, text.excitation)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[[0, 1], [2]]", "sample 1: expected 2 cells as in sample 0, got 1"),
        (100_000 * "[", "not a readable JSON file"),
        ("[[0, 1], [2, null]]", "sample 1: expected a number in column 2, got None"),
        ('{"a": [[0, 1], [2, 3]], "b": [[0, 1]]}', "expected one list of rows, found 2"),
        ("[0, 1, 2]", "expected one list of rows, found 0"),
        ("[[0, 1],", "not a readable JSON file"),
    ],
)
def test_a_json_file_that_is_no_table_is_refused(tmp_path, text, says):
    mistake(tmp_path / "odd.json", says, text=text, channels=[replace(X, column=2)])


def test_bodies_and_uncertainties(headed):
    channels = [
        Channel("x", "beam", "displacement", "mm", sigma="0.01 mm"),
        Channel("u", "layer", "displacement", "V", "1 mm/V", sigma=2e-5),
    ]
    record, excitation = read(Table(headed, channels, time=TimeColumn("t")))
    assert list(record.body.values) == ["beam", "layer"]
    np.testing.assert_allclose(record.displacement_sigma, [1e-5, 2e-5])
    assert excitation is None


def test_a_channel_of_another_kind_keeps_its_unit(headed):
    record, _ = read(Table(headed, [Channel("u", "tank", "level", "V")], time=TimeColumn("t")))
    assert record.level.attrs["units"] == "V"


def test_a_channel_of_another_kind_must_be_in_si(headed):
    with pytest.raises(CalibError, match="must be one of SI without a factor, got 'mV'"):
        read(Table(headed, [Channel("u", "tank", "level", "mV")], time=TimeColumn("t")))


def test_a_prescribed_motion_is_said_and_not_scored(headed):
    drive = ExcitationColumn("x", "mass", "displacement", "mm", cutoff=2.0)
    record, excitation = read(
        Table(headed, [Channel("u", "mass", "force", "V", "35.15 N/V")], drive, time=TimeColumn("t"))
    )
    assert record.attrs["prescribed"] == "mass.displacement,mass.velocity"
    assert excitation.cutoff == 2.0


def test_the_cutoff_acts_on_the_channel_before_it_is_thinned(tmp_path):
    time = np.arange(3000) / 1000.0
    path = tmp_path / "noisy.csv"
    np.savetxt(path, np.c_[np.cos(2 * np.pi * 3 * time) + 0.1 * np.cos(2 * np.pi * 300 * time)])
    table = Table(
        path, [Channel(1, "mass", "displacement", "m")], rate=1000.0, first=500, last=2500, margin=500, cutoff=60
    )
    record, _ = read(replace(table, decimate=25))
    np.testing.assert_allclose(record.displacement[0], np.cos(2 * np.pi * 3 * (record.time + 0.5)), atol=1e-5)


def test_a_missing_file_says_where_to_get_it(tmp_path):
    table = Table(tmp_path / "none.csv", [X], rate=1.0, origin="https://example.org/none", sha256="ab" * 32)
    with pytest.raises(CalibError, match=r"no such file; get it from https://example.org/none \(sha256 abab"):
        read(table)


def test_the_checksum_is_checked(headed):
    right = hashlib.sha256(HEADED.encode()).hexdigest()
    assert right in read(Table(headed, [X], rate=1.0, sha256=right.upper()))[0].attrs["source"]
    with pytest.raises(CalibError, match="expected sha256 abab.*got " + right):
        read(Table(headed, [X], rate=1.0, sha256="ab" * 32))


def mistake(path, says, text=HEADED, channels=(X,), drive=None, layout=None, **options):
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CalibError, match=says):
        read(Table(path, list(channels), drive, text=TextLayout(**layout or {}), **({"rate": 10.0} | options)))


@pytest.mark.parametrize(
    ("says", "change"),
    [
        (
            r"there is no single column 'y'; the columns are \['t', 'x', 'u', 'note'\]",
            {"channels": [Channel("y", "m", "force", "N")]},
        ),
        ("did you mean 'note'", {"channels": [Channel("notes", "m", "force", "N")]}),
        ("no single column 'x'", {"text": "x,x\n1,2\n3,4\n"}),
        ("no header, only columns 1 to 2", {"text": "1,2\n3,4\n"}),
        ("line 3: expected a number in column 'x', got 'two'", {"text": HEADED.replace("2.0", "two")}),
        ("line 3: expected a number in column 'x', got ''", {"text": HEADED.replace("2.0", "")}),
        (
            "line 3: expected a number in column 'x', got 'nan'; `first` and `last` of",
            {"text": HEADED.replace("2.0", "nan")},
        ),
        ("line 4: expected 5 cells as in line 1, got 4", {"text": HEADED.replace("0.2,3.0", "0.2")}),
        ("got '1,5'", {"text": "t;x\n0,1;1,5\n0,2;2,5\n"}),
        ("a quotation mark is not closed", {"text": HEADED.replace("a,", '"a,')}),
        ("at least two samples", {"cutoff": 1.0, "first": 4}),
        (
            "a time that increases",
            {"cutoff": 1.0, "rate": None, "time": TimeColumn("t"), "text": HEADED.replace("0.3,", "0.1,")},
        ),
        ("holds no rows", {"text": "\n# nothing\n"}),
        ("samples 3 to 9 were asked for, but the file has 5", {"first": 3, "last": 9}),
        ("first = 5 of the samples was asked for, but the file has 5", {"first": 5}),
        ("last = 2 is not above first = 4; are they in the wrong order", {"first": 4, "last": 2}),
        (
            """of SI without a factor, got 'mV'; write unit = "V", scale = 0.002""",
            {"channels": [Channel("x", "mass", "bridge", "mV", 2.0)]},
        ),
        (
            'got .mV.; write unit = "V" and, as scale, the number',
            {"channels": [Channel("x", "mass", "bridge", "mV", "2 V/V")]},
        ),
        (
            "column 'x': unit times scale must be in 'm': .*can be given in m",
            {"channels": [Channel("x", "m", "displacement", "V")]},
        ),
        ("two columns are displacement of body 'mass'", {"channels": [X, X]}),
        (
            "velocity is given for some bodies, but not for \\['mass'\\]",
            {"channels": [X, Channel("x", "b", "displacement", "m"), Channel("u", "b", "velocity", "m/s")]},
        ),
        ("between 0 and half the sampling rate", {"cutoff": 6.0}),
        (
            "uniform samples",
            {"cutoff": 1.0, "rate": None, "time": TimeColumn("t"), "text": HEADED.replace("0.3,", "0.35,")},
        ),
        ("time must increase", {"rate": None, "time": TimeColumn("t"), "text": HEADED.replace("0.3,", "0.1,")}),
        ("either a time column or a sampling rate", {"time": TimeColumn("t")}),
        ("either a time column or a sampling rate", {"rate": None}),
        ("rate must be positive", {"rate": 0.0}),
        ("count samples from 0", {"first": -1}),
        ("at least one channel", {"channels": []}),
    ],
)
def test_a_mistake_is_answered(tmp_path, says, change):
    mistake(tmp_path / "table.csv", says, **change)


def test_an_unknown_quantity_is_answered():
    with pytest.raises(CalibError, match="did you mean 'base motion'"):
        ExcitationColumn("u", "mass", "base mtion", "m")


def test_files_that_are_no_tables(tmp_path):
    (tmp_path / "no.mat").write_text("x,y\n1,2\n")
    with pytest.raises(CalibError, match="not a readable MATLAB v5 file"):
        read(Table(tmp_path / "no.mat", [X], rate=1.0))
    (tmp_path / "no.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CalibError, match="not a text file"):
        read(Table(tmp_path / "no.csv", [X], rate=1.0))


@pytest.fixture
def cells(tmp_path):
    """Return a file with a cell array `runs`, 2 x 2: time and displacement of two runs, the second's a matrix."""
    runs = np.empty((2, 2), dtype=object)
    runs[:, 0] = [np.array([[0.0, 0.1, 0.2]]), np.array([[0.0], [0.1]])]
    runs[:, 1] = [np.array([[1.0, 2.0, 3.0]]), np.array([[1.0, 2.0], [3.0, 4.0]])]
    savemat(tmp_path / "cells.mat", {"runs": runs, "label": "by hand", "gain": 3.0})
    return tmp_path / "cells.mat"


def test_cells_of_a_matlab_file_are_columns_by_their_matlab_names(cells):
    record, _ = read(Table(cells, [replace(X, column="runs{1,2}")], time=TimeColumn("runs{1,1}")))
    np.testing.assert_allclose(record.displacement.sel(body="mass"), [1e-3, 2e-3, 3e-3], rtol=1e-15)
    np.testing.assert_allclose(record.time, [0.0, 0.1, 0.2], rtol=1e-15)


@pytest.mark.parametrize(
    ("column", "says"),
    [
        ("run{1,2}", r"cells.mat: there is no single column 'run\{1,2\}' \(did you mean 'runs\{1,2\}'"),
        ("runs{3,1}", r"column 'runs\{3,1\}'.*the columns are \['runs\{1,1\}', 'runs\{1,2\}', 'runs\{2,1\}'"),
        ("runs", r"column 'runs' is a cell array of 2 x 2; name one of its cells, such as 'runs\{1,1\}'"),
        ("runs{2,2}", r"column 'runs\{2,2\}' is an array of 2 x 2, numbers; a column is one row or one column"),
        ("label", "column 'label' is an array of 1, text"),
        ("gain", "column 'gain' is an array of 1 x 1, numbers"),
    ],
)
def test_what_is_no_vector_of_a_matlab_file_is_said(cells, column, says):
    with pytest.raises(CalibError, match=says):
        read(Table(cells, [replace(X, column=column)], rate=10.0))


def test_columns_of_different_length_are_refused(tmp_path):
    savemat(tmp_path / "two.mat", {"x": np.arange(5.0), "u": np.arange(4.0)})
    with pytest.raises(CalibError, match="one length"):
        read(Table(tmp_path / "two.mat", [X], U, rate=1.0))
