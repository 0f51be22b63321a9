"""Files as people export them: each is read as it is meant, or asked about."""

import gzip
import re
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

import gramian as gm
from gramian import io
from gramian.cli import main

TIMES = np.arange(0.0, 1800.0, 60.0)
EAST, NORTH = 2.0 * TIMES, 3.0 * TIMES
BEGIN = datetime(2026, 5, 1, 23, 45)
MOMENTS = [BEGIN + timedelta(seconds=float(t)) for t in TIMES]
LATITUDE = 50.75 + NORTH / 111_247
LONGITUDE = -1.1 + EAST / 70_565


def lines(*rows, end="\n"):
    return "".join(row + end for row in rows)


def comma(value, digits=1):
    return f"{value:.{digits}f}".replace(".", ",")


def plain(form="{:g},{:g},{:g}"):
    return [form.format(*row) for row in zip(TIMES, EAST, NORTH, strict=True)]


def geographic(form):
    rows = zip(MOMENTS, LATITUDE.tolist(), LONGITUDE.tolist(), strict=True)
    return [form(when, latitude, longitude) for when, latitude, longitude in rows]


def sexagesimal(value, letters):
    letter, value = letters[int(value < 0)], abs(value)
    whole, minutes = int(value), 60 * (value % 1)
    return f"{whole}°{int(minutes):02d}'{60 * (minutes % 1):06.3f}\"{letter}"


def iso_week(when):
    year, week, day = when.isocalendar()
    return f"{year}-W{week:02d}-{day}T{when:%H:%M:%S}"


METRES = {
    "a mark of the byte order, units in brackets": "\ufeff"
    + lines("Time,East (m),North (m)", *plain(), end="\r\n"),
    "headings in capitals, other units": lines(
        "TIME [s],EAST [km],NORTH [km],SPEED [kn]",
        *(f"{t},{e / 1e3},{n / 1e3},7.01" for t, e, n in zip(TIMES, EAST, NORTH, strict=True)),
    ),
    "units in a line of their own, in brackets": lines(
        "Time;Easting;Northing",
        "[s];[m];[m]",
        *(
            ";".join(comma(value) for value in row)
            for row in zip(TIMES, EAST, NORTH, strict=True)
        ),
    ),
    "comments and empty lines": "# logger 3.2\n\n"
    + lines("t,x,y", *plain()[:9], "", "# a mark, by hand", *plain()[9:], "#"),
    "commas at the end of the rows": lines("t,x,y", *plain("{:g},{:g},{:g},")),
    "commas at the end of all lines": lines("t,x,y,,", *plain("{:g},{:g},{:g},,")),
    "tabs": lines("t\tx\ty", *plain("{:g}\t{:g}\t{:g}")),
    "reports that came twice": lines("t,x,y", *plain(), plain()[3]),
    "out of order": lines("t,x,y", *reversed(plain())),
    "ends of lines mixed": lines("t,x,y", *plain()[:4])
    + lines(*plain()[4:8], end="\r")
    + lines(*plain()[8:], end="\r\n"),
    "clock times over midnight": lines(
        "time,x,y",
        *(
            f"{when:%H:%M:%S},{e},{n}"
            for when, e, n in zip(MOMENTS, EAST, NORTH, strict=True)
        ),
    ),
    "weeks of ISO 8601": lines(
        "time,x,y",
        *(f"{iso_week(w)},{e},{n}" for w, e, n in zip(MOMENTS, EAST, NORTH, strict=True)),
    ),
    "minutes and seconds, told": lines(
        "time [mm:ss],x,y",
        *(f"{int(t) // 60:02d}:00,{e},{n}" for t, e, n in zip(TIMES, EAST, NORTH, strict=True)),
    ),
    "centimetres": lines(
        "t,x (cm),y (cm)",
        *(f"{t},{100 * e},{100 * n}" for t, e, n in zip(TIMES, EAST, NORTH, strict=True)),
    ),
    "hours": lines(
        "time_h,x,y", *(f"{t / 3600:.17g},{e},{n}" for t, e, n in zip(TIMES, EAST, NORTH, strict=True))
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", METRES.values(), ids=METRES)
@pytest.mark.parametrize("packed", [False, True])
def test_positions_in_metres(tmp_path, text, packed):
    file = tmp_path / ("ship.csv.gz" if packed else "ship.csv")
    content = text.encode()
    file.write_bytes(gzip.compress(content) if packed else content)
    track = io.read(file).track("ship")
    np.testing.assert_allclose(track.times - track.times[0], TIMES, atol=1e-6)
    np.testing.assert_allclose(track.path - track.path[0], np.c_[EAST, NORTH], atol=1e-6)


DEGREES = {
    "a spreadsheet with decimal commas": lines(
        "Time;Latitude;Longitude;Remark",
        *geographic(lambda w, a, o: f"{w:%d.%m.%Y %H:%M:%S};{comma(a, 7)};{comma(o, 7)};ok"),
    ),
    "degrees, minutes and seconds in quotes": lines(
        "Time,LATITUDE,LONGITUDE",
        *geographic(
            lambda w, a, o: ",".join(
                [w.isoformat(), *('"' + s.replace('"', '""') + '"' for s in
                                  (sexagesimal(a, "NS"), sexagesimal(o, "EW")))]
            )
        ),
    ),
    "hemispheres in columns of their own": lines(
        "time,lat,N/S,lon,E/W", *geographic(lambda w, a, o: f"{w.isoformat()},{a!r},N,{-o!r},W")
    ),
    "letters before degrees and minutes": lines(
        "time,lat,lon",
        *geographic(lambda w, a, o: f"{w},N50 {60 * (a - 50):.6f},W{int(-o)} {60 * (-o % 1):.6f}"),
    ),
    "a date and a time of day": lines(
        "Date,Time,Latitude,Longitude",
        *geographic(lambda w, a, o: f"{w:%Y/%m/%d},{w:%H:%M:%S},{a!r},{o!r}"),
    ),
    "UNIX milliseconds": lines(
        "timestamp,lat,lon",
        *geographic(
            lambda w, a, o: f"{1000 * int((w - datetime(1970, 1, 1)).total_seconds())},{a!r},{o!r}"
        ),
    ),
    "bearing, as phones call the course": lines(
        "time,lat,lon,bearing,speed",
        *geographic(lambda w, a, o: f"{w.isoformat()}Z,{a!r},{o!r},33.7,3.6"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", DEGREES.values(), ids=DEGREES)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
def test_positions_in_degrees(tmp_path, text, encoding):
    (tmp_path / "ship.csv").write_bytes(text.encode(encoding))
    found = io.read(tmp_path / "ship.csv")
    track = found.track("ship")
    np.testing.assert_allclose(track.times - track.times[0], TIMES, atol=1e-3)
    # Degrees of this latitude, to a metre in a kilometre.
    np.testing.assert_allclose(track.path - track.path[0], np.c_[EAST, NORTH], atol=8)
    assert not found.sensors
    assert io.read(tmp_path / "ship.csv").epoch == (BEGIN - datetime(1970, 1, 1)).total_seconds()


@pytest.mark.parametrize(
    ("text", "question"),
    [
        (lines("time,x,y", "00:00,0,0", "00:30,60,90", "01:00,120,180"), "minutes and seconds"),
        (lines("time,x,y", "24:00,0,0", "24:30,60,90"), "minutes and seconds"),
        (
            lines("time,lat,lon", *geographic(lambda w, a, o: f"{w},{a / 57.3!r},{o / 57.3!r}")),
            "are these radians",
        ),
        (
            lines("t,lat,ns,lon,ew", "0,50,N,-1,W", "9,50.1,N,-1,W"),
            r"ship.csv:2: lon = -1 and ew = W: has a sign and a hemisphere",
        ),
        (lines("t,lat,a,b,lon", "0,50,N,N,1", "9,50.1,N,N,1"), "a and b may both be"),
        (
            lines(*geographic(lambda w, a, o: f"{w.isoformat()}Z,{a!r},{o!r}")),
            "a header must name the columns",
        ),
        ('{"type": "FeatureCollection", "features": []}', "is JSON"),
        (lines("Zeit;Breite;Länge", "1;50,1;1,5"), "--column time=HEADING"),
        # Degrees and their minutes in two columns.
        (
            lines("t,lat_deg,lat_min,lon_deg,lon_min", "0,50,46,1,6", "9,50,47,1,6"),
            "'lat_min' stands beside 'lat_deg'",
        ),
        # Two ships under one heading, each a few seconds after the other.
        (
            lines(
                "t,x,y",
                *(
                    f"{t:g},{e:g},0\n{t + 7:g},{e + 5e3:g},900"
                    for t, e in zip(TIMES, EAST, strict=True)
                ),
            ),
            "are these 2 ships",
        ),
        # In autumn, by local time.
        (
            lines(
                "time,x,y",
                *(f"2026-10-25 02:{(50 + k) % 60:02d}:00,{60 * k},0" for k in range(20)),
            ),
            "was the clock set back",
        ),
        # The line of a cell, whatever stands above it.
        (lines("t,x,y", "0,0,0", "", "# lost", "60,zero,9"), "ship.csv:5: x = 'zero'"),
    ],
)
def test_what_is_asked_about(tmp_path, text, question):
    (tmp_path / "ship.csv").write_text(text, encoding="utf-8")
    with pytest.raises(gm.InputError, match=question):
        io.read(tmp_path / "ship.csv")


def test_archives(tmp_path):
    (tmp_path / "ship.xlsx").write_bytes(b"PK\x03\x04" + bytes(99))
    with pytest.raises(gm.InputError, match="is a zip archive, as workbooks"):
        io.read(tmp_path / "ship.xlsx")
    (tmp_path / "ship.csv.gz").write_bytes(gzip.compress(lines("t,x,y", *plain()).encode())[:60])
    with pytest.raises(gm.InputError, match="is packed by gzip, and damaged"):
        io.read(tmp_path / "ship.csv.gz")
    (tmp_path / "ship.csv.gz").write_bytes(gzip.compress(bytes(10**6)))
    with pytest.raises(gm.InputError, match="more than 2000 bytes once it is unpacked"):
        io.read(tmp_path / "ship.csv.gz", size_limit=2000)


TURN = np.where(TIMES < 900, 0.0, 2.0 * (TIMES - 900))


def log_of_bearings(heading="bearing_deg"):
    """The observer's own log: where it is, and the bearing to a target."""
    place = np.c_[TURN, 3.0 * np.minimum(TIMES, 900)]
    target = np.c_[4000 - 2.0 * TIMES, 6000 + 1.0 * TIMES]
    seen = np.degrees(np.arctan2(*(target - place).T))
    seen = seen + np.random.default_rng(1).normal(0, 0.2, seen.size)
    rows = zip(TIMES, place, seen.tolist(), strict=True)
    return lines(f"t_s,x,y,{heading}", *(f"{t:g},{x:g},{y:g},{b!r}" for t, (x, y), b in rows))


def test_a_unit_that_is_unknown_is_asked_about(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text(lines("t,x,y,Peilung (mil)", *(f"{row},{k}" for k, row in enumerate(plain()))))
    named = {"bearing": "Peilung (mil)"}
    with pytest.raises(gm.InputError, match="'mil' is no unit of bearing that is known"):
        io.read(file, columns=named)
    seen = io.read(file, columns=named, units={"bearing": "gon"}).sensors["log"]
    np.testing.assert_allclose(seen.bearing, np.arange(TIMES.size) * np.pi / 200)


def test_a_word_in_brackets_beside_dates_is_no_unit(tmp_path):
    file = tmp_path / "ship.csv"
    dated = (f"{w.isoformat()},{e},{n}" for w, e, n in zip(MOMENTS, EAST, NORTH, strict=True))
    file.write_text(lines("Zeit (Schiff),x,y", *dated))
    named = {"time": "Zeit (Schiff)"}
    np.testing.assert_array_equal(io.read(file, columns=named).track("ship").times, TIMES)
    file.write_text(lines("Zeit (Tage),x,y", *plain()))
    with pytest.raises(gm.InputError, match="'Tage' is no unit of time that is known"):
        io.read(file, columns={"time": "Zeit (Tage)"})


def test_an_observers_log_has_its_track_and_its_bearings(tmp_path, capsys, monkeypatch):
    def gramian(*words):
        monkeypatch.setattr("sys.argv", ["gramian", *map(str, words)])
        with pytest.raises(SystemExit) as status:
            main()
        assert status.value.code == 0
        return capsys.readouterr().out

    file = tmp_path / "log.csv"
    file.write_text(log_of_bearings())
    found = io.read(file)
    seen = found.sensors["log"]
    assert (seen.carrier, seen.kinds, seen.times.size) == ("log", ("bearing",), TIMES.size)
    said = gramian("localize", file, "--sigma-deg", "0.2")
    assert "LOCATED" in said
    # Under a heading of its own.
    file.write_text(log_of_bearings("Peilung"))
    assert not io.read(file).sensors
    assert "left out: Peilung" in io.read(file).notes
    named = ["--column", "bearing=Peilung", "--sigma-deg", "0.2"]
    toml = tmp_path / "log.toml"
    gramian("import", file, *named, "--scenario", toml)
    for again in (gramian("localize", file, *named), gramian("localize", toml)):
        assert again == said
    # A spreadsheet's, with a date and a time of day.
    rows = log_of_bearings().splitlines()[1:]
    days = [f"{when:%d.%m.%Y;%H:%M:%S}" for when in MOMENTS]
    table = [f"{day};{row.partition(',')[2]}".replace(",", ";").replace(".", ",") for day, row in
             zip(days, rows, strict=True)]  # fmt: skip
    table = [re.sub(r"^(\d\d),(\d\d),", r"\1.\2.", row) for row in table]
    file.write_text(lines("Datum;Uhrzeit;Ost;Nord;Peilung (°)", *table))
    named = ["date=Datum", "time=Uhrzeit", "east=Ost", "north=Nord", "bearing=Peilung (°)"]
    named = [word for name in named for word in ("--column", name)]
    again = gramian("localize", file, *named, "--sigma-deg", "0.2")
    assert again.split("chi-square")[1] == said.split("chi-square")[1]
    monkeypatch.setattr("sys.argv", ["gramian", "import", str(file), "--column", "bearing"])
    with pytest.raises(SystemExit):
        main()
    assert "must be what it holds and its heading: time=Zeit" in capsys.readouterr().err


def test_frames_by_their_index_of_times():
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame({"x": EAST, "y": NORTH})
    frame.index = pd.date_range(
        "2026-05-01 12:00", periods=TIMES.size, freq="60s", tz="Europe/Berlin"
    )
    found = io.read(frame)
    np.testing.assert_array_equal(found.track("frame").times, TIMES)
    assert found.epoch == datetime(2026, 5, 1, 10, tzinfo=UTC).timestamp()
    frame.index = pd.to_timedelta(TIMES, "s")
    np.testing.assert_array_equal(io.read(frame).track("frame").times, TIMES)
    assert io.read(frame).epoch is None
