"""Each format: a small file read, and a malformed one with its message."""

import datetime as dt

import numpy as np
import pytest

import gramian as gm
from gramian import io

GPX = """<?xml version="1.0"?>
<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">
<wpt lat="50" lon="-1"/>
<trk><name>boat</name><trkseg>
<trkpt lat="50.000" lon="-1.000"><ele>3</ele><time>2026-05-01T12:00:00Z</time></trkpt>
<trkpt lat="50.001" lon="-1.000"><ele>3</ele><time>2026-05-01T12:01:00Z</time></trkpt>
<trkpt lat="50.002" lon="-1.000"><ele>3</ele></trkpt>
</trkseg></trk></gpx>"""

KML = """<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Placemark><name>boat</name><gx:Track>
<when>2026-05-01T12:00:00Z</when><when>2026-05-01T12:01:00Z</when>
<gx:coord>-1.0 50.0 0</gx:coord><gx:coord>-1.0 50.001 0</gx:coord>
</gx:Track></Placemark>
<Placemark><LineString><coordinates>0,0 1,1</coordinates></LineString></Placemark>
</kml>"""

REP = """\
;NARRATIVE: 260501 120000 me something happened
260501\t120000.000\tOwn_ship\t@A\t50\t46\t30\tN\t1\t6\t0\tW\t90.0\t10\t0
260501\t120100.000\tOwn_ship\t@A\t50\t46\t30\tN\t1\t5\t31\tW\t90.0\t10\t0
20260501\t120200.000\tOwn_ship\t@A\t50\t46\t30\tN\t1\t5\t2\tW\t90.0\tNULL\t0
"""

DSF = """\
;SENSOR:\t260501\t120000\tOwn_ship\t@A\tNULL\t-9.5\t1000\tplain something
;SENSOR:\t260501\t120100\tOwn_ship\t@A\tNULL\t350\tNULL\tplain something

;SENSOR2:\t260501\t120000\tOwn_ship\t@A\tNULL\t49 131 150.5\tNULL\t"Towed array" text
;SENSOR2:\t260501\t120100\tOwn_ship\t@A\tNULL\t50 NULL 150.4\tNULL\t"Towed array" text
"""


def write(folder, name, text):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def nmea(body):
    total = 0
    for character in body:
        total ^= ord(character)
    return f"${body}*{total:02X}"


@pytest.mark.parametrize(("name", "text"), [("boat.gpx", GPX), ("boat.kml", KML)])
def test_tracks_in_degrees_are_projected(tmp_path, name, text):
    recording = io.read(write(tmp_path, name, text))
    track = recording.track("boat")
    assert recording.format == name[-3:]
    np.testing.assert_array_equal(track.times, [0, 60])
    # A thousandth of a degree of latitude at 50 degrees north, WGS 84.
    assert np.diff(track.north)[0] == pytest.approx(111.229, abs=1e-3)
    assert dt.datetime.fromtimestamp(recording.epoch, dt.UTC).hour == 12
    assert any("left out" in note for note in recording.notes)


def test_maritime_tracks_and_sensors(tmp_path):
    recording = io.read(write(tmp_path, "a.rep", REP), write(tmp_path, "a.dsf", DSF))
    track = recording.track(None)
    np.testing.assert_array_equal(track.times, [0, 60, 120])
    assert track.longitude[0] == pytest.approx(-1.1)
    assert track.speed[0] == pytest.approx(10 * 1852 / 3600)
    assert np.isnan(track.speed[2])
    plain, towed = recording.sensors["plain"], recording.sensors["Towed array"]
    assert plain.kinds == ("bearing", "range")
    np.testing.assert_allclose(np.degrees(plain.bearing), [-9.5, 350])
    assert plain.range[0] == pytest.approx(914.4)
    assert np.isnan(plain.range[1])
    assert towed.kinds == ("bearing", "ambiguous_bearing", "frequency")
    assert towed.carrier == "Own_ship"
    assert "1 lines ;NARRATIVE: left out" in recording.notes


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("50\t46\t30\tN\t1\t6\t0\tW", "50\t46\t30\tX\t1\t6\t0\tW", r":2: latitude ends in 'X'"),
        ("260501\t120000.000", "261301\t120000.000", r":2: .*is not a date"),
        ("120100.000", "126100.000", r":3: .*126100"),
        ("\t90.0\t10\t0\n20", "\t90.0\tfast\t0\n20", r":3: speed = 'fast'"),
        ("50\t46\t30\tN\t1\t6\t0\tW\t90.0\t10\t0", "50\t46\t30\tN", r":2: has 8 fields"),
        ("50\t46\t30\tN\t1\t6", "50\t66\t30\tN\t1\t6", r":2: latitude 50 66 30 N"),
        ("Own_ship\t@A", '"Own_ship\t@A', "quotation mark"),
    ],
)
def test_malformed_maritime_tracks(tmp_path, old, new, message):
    with pytest.raises(gm.InputError, match=message):
        io.read(write(tmp_path, "a.rep", REP.replace(old, new, 1)))


def test_own_ship_sentences(tmp_path):
    lines = [
        nmea("GPRMC,120000.00,A,5046.500,N,00106.000,W,10.0,090.0,010526,,"),
        nmea("GPGGA,120000.00,5046.500,N,00106.000,W,1,08,1.0,3.0,M,,M,,"),
        nmea("GPRMC,120100.00,A,5046.500,N,00105.500,W,10.0,090.0,010526,,"),
        nmea("GPGSV,1,1,00"),
        "$GPRMC,120200.00,A,5046.500,N,00105.000,W,10.0,090.0,010526,,*00",
        "noise",
    ]
    recording = io.read(write(tmp_path, "log.nmea", "\n".join(lines)))
    track = recording.track("own ship")
    np.testing.assert_array_equal(track.times, [0, 60])
    assert track.latitude[0] == pytest.approx(50.775)
    assert track.longitude[1] == pytest.approx(-(1 + 5.5 / 60))
    said = " ".join(recording.notes)
    assert "wrong checksum" in said
    assert "GSV" in said
    assert "no sentence" in said


def test_ais_reports_take_their_time_from_the_receiver(tmp_path):
    from pyais import encode_dict

    lines = []
    for i in range(3):
        (sentence,) = encode_dict(
            {
                "type": 1,
                "mmsi": 235000001,
                "lat": 50.0 + 0.001 * i,
                "lon": -1.0,
                "speed": 3.6,
                "course": 0.0,
                "second": 10,
            },
            radio_channel="A",
            talker_id="AI",
        )
        lines.append(f"\\c:{1777636800 + 60 * i + 12}*00\\{sentence}")
    far = encode_dict({"type": 1, "mmsi": 1, "lat": 91, "lon": 181}, talker_id="AI")[0]
    recording = io.read(write(tmp_path, "log.ais", "\n".join([*lines, far])))
    track = recording.track("235000001")
    np.testing.assert_array_equal(track.times, [0, 60, 120])
    assert recording.epoch % 60 == 10
    assert np.degrees(track.course[0]) == 0
    assert any("without a position" in note for note in recording.notes)


def test_parts_of_two_ais_messages_are_not_joined(tmp_path):
    from pyais import encode_dict

    def parts(kind, **said):
        return encode_dict({"type": kind, **said}, talker_id="AI", seq_id=3)

    place = {"lat": 50.0, "lon": -1.0, "speed": 3.6, "course": 0.0, "second": 5}
    lost = parts(5, mmsi=111, shipname="GHOST SHIP OF A LONG NAME")
    whole = parts(5, mmsi=222, shipname="AURORA")
    assert len(lost) == len(whole) == 2
    reports = [parts(1, mmsi=mmsi, **place)[0] for mmsi in (111, 222)]
    # The first part of one message is lost; of another the second.
    sentences = [lost[1], *whole, lost[0], *whole, *reports]
    lines = [f"\\c:{1777636800 + k}*00\\{one}" for k, one in enumerate(sentences)]
    found = io.read(write(tmp_path, "log.ais", "\n".join(lines)))
    assert set(found.tracks) == {"111", "AURORA"}
    assert any("2 AIS messages of which a part is lost" in note for note in found.notes)


def test_a_log_without_a_clock_says_so(tmp_path):
    from pyais import encode_dict

    (sentence,) = encode_dict({"type": 1, "mmsi": 1, "lat": 50, "lon": 1}, talker_id="AI")
    with pytest.raises(gm.InputError, match="AIS positions before the first time"):
        io.read(write(tmp_path, "log.ais", sentence))


@pytest.mark.parametrize(
    ("text", "times"),
    [
        ("t,x,y\n0,0,0\n60,0,100\n", [0, 60]),
        ("time_min;east_km;north_km\n0;0;0\n1;0;0,1\n", [0, 60]),
        ("time\tx\ty\n23:59:30\t0\t0\n00:00:30\t0\t100\n", [86370, 86430]),
        ("t_ms|x|y\n0|0|0\n60000|0|100\n", [0, 60]),
        ("# a comment\n\nTimestamp,X (ft),Y (ft)\n0,0,0\n60,0,328.0839895\n", [0, 60]),
        ("time,x,y\n2026-05-01T14:00:00+02:00,0,0\n2026-05-01T12:01:00Z,0,100\n", [0, 60]),
        ("timestamp,x,y\n1777636800,0,0\n1777636860,0,100\n", [0, 60]),
        ("timestamp,x,y\n1777636800000,0,0\n1777636860000,0,100\n", [0, 60]),
        ("t x y\n0 0 0\n60 0 100\n", [0, 60]),
        ("sep=;\nt;x;y;comment\n0;0;0;\n60;0;100;late\n", [0, 60]),
        ("t,x,y\n60,0,100\n0,0,0\n60,0,100\n30,,\n", [0, 60]),
    ],
)
def test_tables_in_their_many_forms(tmp_path, text, times):
    track = io.read(write(tmp_path, "ship.csv", text)).track("ship")
    np.testing.assert_allclose(track.times, times)
    np.testing.assert_allclose(track.path, [[0, 0], [0, 100]], atol=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "50.775", "50°46.5'N", "50 46 30 N", "N 50:46:30", "50,775", "+50.775", '50d46\'30"N',
    ],
)  # fmt: skip
def test_latitudes_in_their_many_forms(tmp_path, text):
    lines = f"t;lat;lon\n0;{text};-1\n60;{text};-1.001\n"
    track = io.read(write(tmp_path, "ship.csv", lines)).track("ship")
    np.testing.assert_allclose(track.latitude, 50.775, rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("0,1,2\n1,2,3\n", "a header must name the columns"),
        ("t,x,y\n0,0\n", r":2: has 2 cells: must have 3"),
        ("t,x,y\n0,0,0\n1,0,zero\n", r":3: y = 'zero': must be a number"),
        ("t,x,y\n0,0,inf\n", r":2: y = inf: must be finite"),
        ("t,x,y\n", "no rows"),
        ("t,a,b\n0,1,2\n", "no columns are recognised as a position"),
        ("x,y\n1,2\n", "no column is recognised as the time"),
        ("time,x,y\n2026-05-01T12:00:00,0,0\n2026-05-01T12:01:00Z,0,1\n", "have no|have none"),
        ("time,x,y\n25:00:00,0,0\n", "is not a time of day"),
        ("time,x,y\nnoon,0,0\n", r"\[0\] = 'noon': must be seconds"),
        ("t,x,y\n0,0,0\n0,0,1\n", "is at two places at 0 s"),
        ("t;lat;lon\n0;95;1\n1;95;1\n", "latitude = 95 deg"),
        ("t;lat;lon\n0;50 61 N;1\n", "minutes and seconds must be below 60"),
        ("t;lat;lon\n0;-50S;1\n", "a sign and a hemisphere"),
        ("t;lat;lon\n0;north;1\n", r"lat\[0\] = 'north'"),
        ("t,x,y\n45000.5,0,0\n45000.6,0,1\n", "day numbers of a spreadsheet"),
    ],
)
def test_malformed_tables(tmp_path, text, message):
    with pytest.raises(gm.InputError, match=message):
        io.read(write(tmp_path, "ship.csv", text))


def test_parquet(tmp_path):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    when = [dt.datetime(2026, 5, 1, 12, 0, i, tzinfo=dt.UTC) for i in range(3)]
    table = pa.table({"when": when, "east": [0.0, None, 2.0], "north": [0.0, 1.0, 2.0]})
    parquet.write_table(table, tmp_path / "ship.parquet")
    track = io.read(tmp_path / "ship.parquet").track("ship")
    np.testing.assert_array_equal(track.times, [0, 2])
    (tmp_path / "bad.parquet").write_bytes(b"PAR1 no")
    with pytest.raises(gm.InputError, match=r"bad\.parquet: cannot be read"):
        io.read(tmp_path / "bad.parquet")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("graph.g2o", "VERTEX_SE2 0 0 0 0\n", "is a pose graph: read_graph"),
        ("a.gpx", GPX[:200], "is not valid GPX"),
        ("a.gpx", "<gpx version='1.1' creator='t'><wpt lat='1' lon='1'/></gpx>", "no track"),
        ("a.kml", KML.replace("</kml>", ""), "is not valid KML"),
        ("a.kml", KML.replace("<gx:coord>-1.0 50.0 0</gx:coord>", ""), "2 times and 1 places"),
        ("a.kml", KML.replace("-1.0 50.0 0", "-1.0 fifty 0"), "coordinates"),
        ("a.kml", "<!DOCTYPE x><kml/>", "document type"),
        ("a.nmea", "$GPGSV,1,1,00", "no position with a time"),
        ("a.dsf", ";SENSOR:\t260501\t120000\tA\t@A\tNULL\t700\t1\ts", "must be within"),
        ("a.dsf", ";SENSOR:\t260501\t120000\tA\t@A\tNULL\t70", "fields after its keyword"),
        ("a.dsf", ";SENSOR:\t260501\t120000\tA\t@A\tNULL\t70\t-5\ts", "range -5 yards"),
    ],
)
def test_malformed_files(tmp_path, name, text, message):
    with pytest.raises(gm.InputError, match=message):
        io.read(write(tmp_path, name, text))


def test_a_log_that_ends_in_zeros(tmp_path):
    """As a logger leaves it that lost its power: the lines before are read."""
    lines = [
        nmea(f"GPRMC,1200{k:02}.00,A,5046.500,N,0010{6 - 0.0044 * k:.4f},W,10.0,090.0,010526,,")
        for k in range(6)
    ]
    torn = "\n".join(lines).encode() + b"\n" + lines[0][:20].encode() + b"\0" * 60
    (tmp_path / "log.nmea").write_bytes(torn)
    recording = io.read(tmp_path / "log.nmea")
    (track,) = recording.tracks.values()
    assert track.times.size == 6
    (tmp_path / "ship.csv").write_bytes(b"time,east,north\n0,0,0\n1,5,\0\0\n")
    with pytest.raises(gm.InputError, match=r"ship\.csv:3: north = "):
        io.read(tmp_path / "ship.csv")


def test_what_is_no_text_file(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"\0\1\2" * 100)
    with pytest.raises(gm.InputError, match="is not a text file"):
        io.read(tmp_path / "a.csv")
    with pytest.raises(gm.InputError, match="cannot be read"):
        io.read(tmp_path / "missing.csv")
    with pytest.raises(gm.InputError, match="not a regular file"):
        io.read("/dev/zero")
    with pytest.raises(gm.InputError, match="size_limit"):
        io.read(write(tmp_path, "b.csv", "t,x,y\n0,0,0\n"), size_limit=4)


def test_plane_is_true_from_its_origin():
    from pyproj import Geod

    from gramian.io._plane import to_plane

    origin = (50.0, -1.0)
    geod = Geod(ellps="WGS84")
    for azimuth in (0.0, 37.0, 200.0):
        longitude, latitude, _ = geod.fwd(origin[1], origin[0], azimuth, 100_000)
        east, north = to_plane(np.array([latitude]), np.array([longitude]), origin)
        assert np.hypot(east, north)[0] == pytest.approx(100_000, abs=1e-3)
        assert np.degrees(np.arctan2(east, north))[0] % 360 == pytest.approx(azimuth, abs=1e-7)
    # Between two points 100 km out on either side of the origin's meridian, 4 m in 10 km.
    ends = [geod.fwd(origin[1], origin[0], a, 100_000) for a in (-3.0, 3.0)]
    true = geod.inv(ends[0][0], ends[0][1], ends[1][0], ends[1][1])[2]
    east, north = to_plane(np.array([e[1] for e in ends]), np.array([e[0] for e in ends]), origin)
    drawn = np.hypot(np.diff(east), np.diff(north))[0]
    assert 0 < drawn / true - 1 < 1e5**2 / (6 * 6.36e6**2) * 1.1


@pytest.mark.parametrize("library", ["pandas", "pandas index", "polars", "pyarrow", "xarray"])
def test_frames(library):
    module = pytest.importorskip(library.partition(" ")[0])
    start = dt.datetime(2026, 5, 1, 12)
    when = [start + dt.timedelta(seconds=30 * i) for i in range(3)]
    columns = {"time": when, "lat": [50.0, None, 50.002], "lon": [-1.0, -1.0, -1.0]}
    if library == "pyarrow":
        frame = module.table(columns)
    elif library == "xarray":
        frame = module.Dataset(
            {"lat": ("time", [50.0, np.nan, 50.002]), "lon": ("time", [-1.0] * 3)},
            coords={"time": np.array(when, dtype="datetime64[ns]")},
        )
    else:
        frame = module.DataFrame(columns) if library != "pandas index" else pytest.importorskip(
            "pandas").DataFrame(columns).set_index("time")  # fmt: skip
    recording = io.read(frame)
    track = recording.track("frame")
    np.testing.assert_array_equal(track.times, [0, 60])
    np.testing.assert_allclose(np.diff(track.north), 222.4, atol=0.1)
    assert recording.epoch == 1777636800


def test_units_of_a_dataset_count_and_what_is_no_frame_is_named():
    xarray = pytest.importorskip("xarray")
    data = xarray.Dataset(
        {"east": ("time", [0.0, 1.0], {"units": "km"}), "north": ("time", [0.0, 0.0])},
        coords={"time": ("time", [0.0, 1.0], {"units": "min"})},
    )
    track = io.read(data).track(None)
    np.testing.assert_array_equal(track.east, [0, 1000])
    np.testing.assert_array_equal(track.times, [0, 60])
    with pytest.raises(gm.InputError, match="must be a path, or a frame of pandas"):
        io.read({"t": [0, 1]})


@pytest.mark.parametrize(
    ("times", "dates"),
    [
        ("01.05.2026 12:00:00|01.05.2026 12:01:00", None),
        ("13/05/2026 12:00:00|13/05/2026 12:01:00", None),
        ("05/13/26 11:59:30 AM|05/13/26 12:00:30 PM", None),
        ("01/05/26 12:00|01/05/26 12:01", "day first"),
        ("01/05/2026 12:00|01/05/2026 12:01", "month first"),
        ("2016-12-31T23:59:60Z|2017-01-01T00:01:00Z", None),
        ("11:59:30 am|12:00:30 pm", None),
    ],
)
def test_dates_as_they_are_written(tmp_path, times, dates):
    first, second = times.split("|")
    path = write(tmp_path, "ship.csv", f"time;x;y\n{first};0;0\n{second};500;1\n")
    recording = io.read(path, dates=dates)
    np.testing.assert_array_equal(np.diff(recording.track("ship").times), 60)
    days = {"13": "2026-05-13", "05": "2026-05-13", "20": "2017-01-01", "11": None}
    day = {"day first": "2026-05-01", "month first": "2026-01-05"}.get(
        dates, days.get(first[:2], "2026-05-01")
    )
    assert (recording.epoch is None) == (day is None)
    assert day is None or io.utc(recording.epoch).startswith(day)


def test_a_column_of_dates_beside_the_time_of_day(tmp_path):
    text = "date,time,x,y\n2026-05-01,23:59:30,0,0\n2026-05-04,00:00:30,90000,1\n"
    track = io.read(write(tmp_path, "ship.csv", text)).track("ship")
    np.testing.assert_array_equal(track.times, [0, 2 * 86400 + 60])


@pytest.mark.parametrize(
    "text",
    [
        "# made by a logger\n# Time [s],X [km],Y [km]\n0,0,0.5\n60,1,1.5\n",
        "time;x;y\ns;km;km\n0;0;0,5\n60;1;1,5\n",
        "sep=;\ntime_s;x_km;y_km\r\n0;0;0,5\n60;1;1,5\r",
        "time_min\tx_m\ty_m\tcomment\n0\t0\t500\tstart\n1\t1000\t1500\t\n",
    ],
)
def test_headers_and_units_where_they_stand(tmp_path, text):
    path = tmp_path / "ship.csv"
    path.write_bytes(text.encode())
    track = io.read(path).track("ship")
    np.testing.assert_allclose(track.times, [0, 60])
    np.testing.assert_allclose(track.path, [[0, 500], [1000, 1500]])


def test_what_is_left_out_of_a_log_is_named_by_its_reason_and_nan_is_missing(tmp_path):
    log = tmp_path / "own.nmea"
    body = "GPGGA,120000.00,5046.500,N,00106.000,W,1,08,1.0,3.0,M,,M,,"
    log.write_text(nmea(body) + "\n")
    with pytest.raises(gm.InputError, match="GGA before the date of an RMC"):
        io.read(log)
    track = tmp_path / "own.rep"
    line = "260501 12{:02d}00 OWN @C 50 46 30 N 1 5 {} W 90.0 NULL NaN\n"
    track.write_text("".join(line.format(k, 2 + k) for k in range(5)))
    assert len(io.read(track).tracks) == 1


def test_a_bearing_beyond_a_turn_is_asked_about(tmp_path):
    file = tmp_path / "b.csv"
    bearings = [-999 if k == 3 else 40 + k for k in range(12)]
    rows = "".join(f"{60 * k},{value}\n" for k, value in enumerate(bearings))
    file.write_text("time,bearing_deg\n" + rows)
    with pytest.raises(gm.InputError, match="-999 deg is beyond a whole turn"):
        io.read(file)
    assert io.read(file, trust=["bearings"]).sensors
