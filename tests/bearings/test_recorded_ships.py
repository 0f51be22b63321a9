"""Real ships: bounds on recorded geometry, through the scenario file a user would write."""

import numpy as np
import pytest

from gramian.scenario import load

pytestmark = pytest.mark.recorded


@pytest.fixture
def scenario(recorded, tmp_path):
    def make(observer, target, start, max_gap=120.0):
        path = tmp_path / "scenario.toml"
        path.write_text(f"""
            model = "bearings"
            [tracks]
            file = "{recorded("ais_solent.csv").as_posix()}"
            columns = {{ id = "vessel", time = "t_s", east = "east_m", north = "north_m" }}
            observer = "{observer}"
            target = "{target}"
            max_gap = {max_gap}
            [window]
            start = {start}
            duration = 900.0
            step = 15.0
            [noise]
            bearing_deg = 0.5
        """)
        return load(path)

    return make


@pytest.mark.parametrize(
    ("observer", "target", "start", "relative", "bounds", "headline"),
    [
        ("observer_ferry_b", "ship_j", 400.0, 0.003834, (2.065, 2.747), "OBSERVABLE"),
        ("observer_ferry_a", "ship_h", 3800.0, 0.128525, (68.53, 39.49), "OBSERVABLE"),
        ("observer_ferry_a", "ship_e", 1900.0, 0.535532, (1737.6, 2039.3), "WEAKLY OBSERVABLE"),
        ("observer_d", "ship_g", 900.0, 5.945635, (7103.6, 132680), "HOPELESS"),
    ],
)
def test_bounds_on_recorded_geometry(scenario, observer, target, start, relative, bounds, headline):
    report = scenario(observer, target, start, max_gap=900.0).analyze()
    assert report.data["bearings"] == 61
    assert report.data["relative_bound"] == pytest.approx(relative, abs=6e-7)
    found = report.data["observability"]["crlb_std"][:2]
    # As many digits as are stated: half a unit of the last one.
    for value, stated in zip(found, bounds, strict=True):
        digits = len(str(stated).replace(".", "").rstrip("0"))
        assert float(f"{value:.{digits}g}") == pytest.approx(stated, rel=1e-12)
    assert report.headline.startswith(headline)


def test_the_misfit_of_a_ship_that_turned_is_shown(scenario):
    report = scenario("observer_ferry_a", "ship_h", 1200.0).analyze()
    assert report.data["relative_bound"] == pytest.approx(0.005, abs=5e-4)
    found = report.data["constant_velocity"]
    assert not found["holds"]
    assert found["off_line_max"] == pytest.approx(127, abs=5)
    assert "IF IT KEEPS ITS COURSE" in report.headline
    assert np.hypot(*found["bias"][:2]) > 2 * np.hypot(
        *report.data["observability"]["crlb_std"][:2]
    )


def test_a_gap_in_the_record_is_named(scenario):
    with pytest.raises(Exception, match=r"ship_g has a gap of 469 s"):
        scenario("observer_d", "ship_g", 900.0).analyze()
