"""What each key of a scenario file means, with its unit and an example.

One line for each field of each class: ``Class.field | unit | meaning | example``. The
types, defaults and limits are those of the classes; a test holds the two together.
"""

from __future__ import annotations

from functools import cache

__all__ = ["KEYS", "Key", "key_of"]

#: Unit, meaning and example.
Key = tuple[str, str, str]

_TABLES = """
Reading.units | | what a column holds -> its unit, where its heading does not say it | { east = "km", speed = "kn" }
Reading.separator | | what separates the cells; found where it is not given | ";"
Reading.decimal | | the decimal sign; found where it is not given | ","
Reading.dates | | the order in dates such as 01/05/2026, where it does not show itself | "day first"
Reading.trust | | checks for slips to leave out | ["speed"]
"""

KEYS: dict[str, str] = {
    "bearings": _TABLES
    + """
BearingsScenario.tracks | | where the observer was, and the target if that is recorded |
BearingsScenario.target | | a target at constant velocity in place of a recorded one |
BearingsScenario.bearings | | measured bearings; their times are then those of the analysis too |
BearingsScenario.window | | when bearings are taken; without it the time that the tracks share |
BearingsScenario.noise | | how good the bearings are |
BearingsScenario.prior | m, m/s, rad | what is known: a standard deviation, or a mean and one | { speed = 0.5 }
BearingsScenario.known | | states that are known exactly | ["vx", "vy"]
BearingsScenario.limits | | from where on a state counts as weakly known |
Tracks.file | | one file of tracks, or several, of any format of docs/howto/files.md | "tracks.csv"
Tracks.target_file | | the target's file, if it is another | "target.gpx"
Tracks.columns | | what the columns are called, where their headings do not say it |
Tracks.observer | | the track of the observer | "pilot_boat"
Tracks.target | | the track of the target | "tanker"
Tracks.max_gap | s | positions are interpolated between two reports no further apart than this | 300.0
Columns.id | | the column that says whose position it is | "mmsi"
Columns.date | | the column of dates, where that of times has the time of day only | "day"
Columns.time | | the column of times | "t"
Columns.east | | the column of positions to the east | "x_km"
Columns.north | | the column of positions to the north | "y_km"
Columns.latitude | | the column of latitudes | "lat"
Columns.longitude | | the column of longitudes | "lon"
Columns.height | | the column of heights | "alt"
Columns.speed | | the column of speeds, by which units are checked | "sog"
Columns.course | | the column of courses, by which axes are checked | "cog"
Columns.bearing | | the column of bearings that were taken from the same carrier | "brg"
Columns.sensor | | the column that says which sensor took them | "array"
MeasuredBearings.file | | the file of bearings; without it they are in the files of tracks | "bearings.csv"
MeasuredBearings.sensor | | whose bearings, where several sensors have some | "Frigate_Optic"
MeasuredBearings.columns | | what the columns are called |
BearingColumns.time | | the column of times | "t"
BearingColumns.bearing_deg | | the column of bearings in degrees clockwise from north | "brg"
BearingColumns.bearing_rad | | the same in radians | "beta"
Target.x0 | m | east at the first bearing | 2500.0
Target.y0 | m | north at the first bearing | 4200.0
Target.vx | m/s | velocity to the east | -3.4
Target.vy | m/s | velocity to the north | -1.2
Window.start | s | seconds as the files count them, a date, or seconds from the first instant that the tracks share; by default that instant | "+600"
Window.duration | s | how long | 900.0
Window.step | s | from one bearing to the next where none are measured; by default a sixtieth of the duration | 15.0
Noise.bearing_deg | deg | standard deviation of a bearing | 0.5
Known.sigma | m, m/s, rad | standard deviation | 0.5
Known.mean | m, m/s, rad | the value; `localize` needs it | 6.0
Limits.position | m | by default a quarter of the mean range | 500.0
Limits.velocity | m/s | by default a quarter of the mean range over the duration | 1.0
""",
    "dipole": """
DipoleScenario.sensors | m | the place of each sensor: x, y, z | [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]
DipoleScenario.ambient_uT | uT | the field without the dipole; with it sensors are of the total field, and have one number in place of three | [20.0, -1.0, -45.0]
DipoleScenario.baselines | m | of gradiometers, from each sensor to its second head; one for all or one for each | [[0.0, 0.0, 1.0]]
DipoleScenario.record | | a recorded field |
DipoleScenario.pass | | an assumed pass in place of a record |
DipoleScenario.known | m, m/s, A m^2 | what is known exactly | { z = 0.5, vz = 0.0 }
DipoleScenario.prior | m, m/s, A m^2 | what is known to a standard deviation | { speed = { mean = 5.6, sigma = 0.3 } }
DipoleScenario.fit | | how the record is fitted |
Columns.time | | the column of times; dates and clock times are read too | "t_s"
Columns.field | | three columns for each sensor; of the total field one | [["s1_x_uT", "s1_y_uT", "s1_z_uT"]]
Select.column | | the column that chooses rows | "pass"
Select.value | | what it has in the rows that are used | "car_20"
Record.file | | a table of the field, CSV or Parquet | "dipole_pass.csv"
Record.columns | | what the columns are called |
Record.unit | | unit of the field in the file | "uT"
Record.select | | only some of the rows |
Record.missing | | what is done about empty cells | "drop"
Window.start | s | first time that is used | 2.0
Window.end | s | last time that is used | 8.0
Prior.mean | m, m/s, A m^2 | the value | 5.6
Prior.sigma | m, m/s, A m^2 | standard deviation | 0.3
Fit.background | | what is done about a constant field beside the dipole's | "fit"
Fit.loss | | whether outliers are held back | "gaussian"
Fit.window | | the times that are used: the pass that is found in the record, or a start and an end | { start = 2.0, end = 8.0 }
Fit.sigma_nT | nT | noise of the field: of all, of each sensor, or of the components of each, inf for what is not used; by default it is measured in the record | 50.0
Fit.starts | | how many starts the search has | 24
Fit.sources | | the numbers of dipoles on the body that are tried | [1, 2]
Fit.motion | | the motions that are tried | ["straight", "turning"]
Fit.attitude_deg | deg | standard deviation of the attitude of each sensor, which is estimated then | 2.0
Fit.scale | | of the scale of each sensor, relative to 1 | 0.01
Fit.earth_field_uT | uT | the ambient field, of a body that it magnetises too | [20.0, -1.0, -45.0]
Fit.correlation | | of the noise of neighbouring samples, from 0 to below 1, or "fit" | 0.9
Fit.use | | which channels are used, three for each sensor, or one of the total field | [true, true, false]
Pass.r0 | m | position at time 0: x, y, z | [-10.0, -10.0, 5.0]
Pass.v | m/s | velocity | [1.0, 1.0, 0.0]
Pass.m | A m^2 | magnetic moment | [10.0, 20.0, 10.0]
Pass.duration | s | how long | 20.0
Pass.step | s | from one sample to the next | 0.5
Pass.sigma_nT | nT | noise: of all, of each sensor, or of the components of each, inf for what is not measured | [[0.1, 0.1, 0.3]]
Pass.quadrupole | A m^3 | of the body, at the place of its dipole: symmetric, without trace | [[50.0, 10.0, 0.0], [10.0, -30.0, 5.0], [0.0, 5.0, -20.0]]
Pass.dipoles | | the dipoles of the body after the first, at most three: tables of `offset` and `m` |
Pass.acceleration | m/s^2 | along the track, or its three components | 0.01
Pass.turn_rate_deg_s | deg/s | about z, clockwise seen from above | 0.5
Pass.induced_volume | m^3 | of the moment that `earth_field_uT` induces in the body | 0.1
Pass.earth_field_uT | uT | the Earth's field, which induces a moment | [0.0, 18.0, -45.0]
Pass.attitude_deg | deg | deviation of each sensor's attitude, an error that is estimated | 1.0
Pass.scale | | deviation of each sensor's scale factor, an error that is estimated | 0.01
Further.offset | m | from the first dipole | [2.0, 1.0, 0.0]
Further.m | A m^2 | magnetic moment | [-5.0, 3.0, 8.0]
""",
    "inertial": """
InertialScenario.site | | where it begins |
InertialScenario.flight | | how it moves; without it, it stands still, level, heading north |
InertialScenario.recorded | | a flight of one's own, in the place of `flight` |
InertialScenario.odometer_arm | m | from the navigator to the wheels: forward, left, up | [1.0, 0.0, -0.5]
InertialScenario.estimated | | what is estimated beside the 15 states: lever_arm, gyro_scale, gyro_misalignment, accelerometer_scale, accelerometer_nonorthogonality, accelerometer_misalignment, g_sensitivity, odometer_scale, odometer_mounting, odometer_arm | ["gyro_scale"]
InertialScenario.outputs | | what is measured: velocity, position, odometer, side_slip, zero_velocity, zero_angular_rate, heading | ["position", "odometer"]
InertialScenario.window | | how long and how often the receiver gives its outputs |
InertialScenario.prior | | what is known beforehand |
InertialScenario.noise | | how good the receiver is |
InertialScenario.lever_arm | m | from the navigator to the antenna: forward, left, up | [2.0, 0.0, -1.0]
Site.latitude_deg | deg | geodetic latitude | 28.15
Site.height | m | above the ellipsoid | 100.0
Leg.duration | s | how long | 60.0
Leg.turn_deg | deg | change of heading over the leg, clockwise | 90.0
Leg.speed_change | m/s | change of speed over the leg | 20.0
Leg.bank_deg | deg | bank, right side down | 15.0
Recorded.file | | table of attitude and velocity, beside the scenario | "flight.csv"
Recorded.columns | | what its columns are called |
Recorded.legs | s | when each leg but the first begins | [60.0, 150.0]
Recorded.names | | what the legs are called | ["taxi", "climb", "turn"]
Recorded.step | s | longest segment with constant coefficients | 2.0
Recorded.largest_turn_deg | deg | largest change of attitude in a segment | 3.0
Columns.time | | seconds, dates or clock times | "time"
Columns.v_north | | velocity to the north, m/s | "v_north"
Columns.v_east | | velocity to the east, m/s | "v_east"
Columns.v_up | | velocity upwards, m/s | "v_up"
Columns.heading_deg | | clockwise from north, degrees | "heading_deg"
Columns.pitch_deg | | nose up, degrees | "pitch_deg"
Columns.roll_deg | | right side down, degrees | "roll_deg"
Flown.speed | m/s | at the beginning | 50.0
Flown.heading_deg | deg | at the beginning, clockwise from north | 45.0
Flown.legs | | the parts of the flight, in order | [{ duration = 60.0 }, { duration = 30.0, turn_deg = 90.0 }]
Known.tilt_arcmin | arcmin | standard deviation of each attitude error | 1.0
Known.velocity | m/s | of each velocity error | 0.1
Known.position | m | of each position error | 10.0
Known.gyro_bias_deg_per_hour | deg/h | of each gyroscope bias | 0.01
Known.accelerometer_bias_micro_g | micro g | of each accelerometer bias | 100.0
Noise.velocity | m/s | standard deviation of a velocity | 0.01
Noise.position | m | standard deviation of a position | 1.0
Window.duration | s | how long | 3600.0
Window.step | s | from one output to the next | 1.0
""",
    "linear": """
LinearScenario.system | | the matrices |
LinearScenario.combinations | | named combinations of states | { reading = { position = 1.0, offset = 1.0 } }
LinearScenario.window | | how long and how often outputs are taken |
LinearScenario.noise | | how good the outputs are |
LinearScenario.prior | units of the states | what each state is known to, standard deviation | { position = 1.0 }
Matrices.A | 1 / time | a row for each state | [[0.0, 1.0], [-0.25, -0.02]]
Matrices.C | | a row for each output | [[1.0, 0.0]]
Matrices.names | | of the states | ["position", "velocity"]
Matrices.units | | of the states | ["m", "m/s"]
Matrices.time | | whether A is a derivative or a step | "discrete"
Window.duration | the system's time | how long | 60.0
Window.step | the system's time | from one output to the next | 0.5
Noise.output | units of the outputs | standard deviation, one for all or one for each | 0.01
""",
    "registration": """
RegistrationScenario.sensors | | the sensors by name |
RegistrationScenario.extras | | biases beside those of range and angles | ["gain"]
RegistrationScenario.targets | | recorded tracks of targets |
RegistrationScenario.tracks | | targets on straight lines, by name |
RegistrationScenario.reports | | what the sensors measured |
RegistrationScenario.biases | m, deg | put into simulated reports: a sensor -> its biases | { A = { range = 300.0 } }
RegistrationScenario.useless | m, deg | standard deviations from which a bias counts as weakly known | { range = 100.0 }
RegistrationScenario.seed | | of the noise in simulated reports | 2013
RegistrationScenario.select | | how many targets to choose | 2
RegistrationScenario.estimate | | how biases are estimated |
RegistrationScenario.maps | | maps of where a target tells most |
Sensor.east | m | its place, at time 0 if it moves | 60000.0
Sensor.north | m | likewise | 0.0
Sensor.up | m | likewise, for sensors in space | 20.0
Sensor.velocity | m/s | of a sensor that moves steadily: east, north and up | [0.0, 8.0]
Sensor.file | | a table of the path of a sensor that moves, CSV or Parquet | "ship.csv"
Sensor.columns | | what its columns are called |
Sensor.heading_deg | deg | of what carries it; that of the velocity by default | 30.0
Sensor.azimuths | | what azimuths count from: north or the heading | "heading"
PathColumns.time | | the column of times, counted as those of the targets | "t_s"
PathColumns.east | | the column of positions to the east, m | "east_m"
PathColumns.north | | the column of positions to the north, m | "north_m"
PathColumns.up | | the column of heights, m | "altitude_m"
PathColumns.heading_deg | | the column of headings, degrees clockwise from north | "heading_deg"
Sensor.sigma_range | m | standard deviation of a range | 50.0
Sensor.sigma_azimuth_deg | deg | standard deviation of an azimuth | 0.1
Sensor.sigma_elevation_deg | deg | standard deviation of an elevation, for sensors in space | 0.2
TargetColumns.id | | the column that says whose position it is | "aircraft"
TargetColumns.time | | the column of times | "t_s"
TargetColumns.east | | the column of positions to the east, m | "east_m"
TargetColumns.north | | the column of positions to the north, m | "north_m"
TargetColumns.up | | the column of heights, m | "altitude_m"
Targets.file | | a table, CSV or Parquet | "aircraft.csv"
Targets.columns | | what the columns are called |
Targets.names | | only these targets | ["A01", "A02"]
Track.start | m | position at time 0: east, north and up | [-20000.0, 25000.0]
Track.velocity | m/s | likewise | [400.0, 0.0]
Track.duration | s | how long | 199.0
Track.step | s | from one report to the next | 1.0
ReportColumns.target | | the column that says which target it is | "target"
ReportColumns.time | | the column of times | "t_s"
ReportColumns.sensor | | the column that says which sensor saw it | "radar"
ReportColumns.range | | the column of ranges, m | "range_m"
ReportColumns.azimuth_deg | | the column of azimuths, degrees clockwise from north, or from the sensor's heading | "azimuth_deg"
ReportColumns.elevation_deg | | the column of elevations, degrees | "elevation_deg"
Reported.file | | a table, CSV or Parquet | "reports.csv"
Reported.columns | | what the columns are called |
Reported.interpolate | | whether reports are brought to the times of the first sensor | "linear"
Reported.missing | | looks that not every sensor reports are left out, or refused | "raise"
Reported.tolerance | s | times closer than this are the same | 0.01
Reported.max_gap | s | reports further apart are not interpolated between | 30.0
Estimation.method | | least squares, weighted, or maximum likelihood | "gls"
Estimation.loss | | how residuals count: the others bear gross reports | "huber"
Estimation.clocks | | whether the sensors' clocks may be off | true
Estimation.prior | m, deg | standard deviations about 0: a sensor -> its biases | { A = { range = 100.0 } }
Map.west | m | edge | -50000.0
Map.east | m | edge | 110000.0
Map.south | m | edge | -50000.0
Map.north | m | edge | 100000.0
Map.heading_deg | deg | of the target's motion; without it of a circle | 90.0
Map.radius | m | of the circle, or half the length of the straight track | 2000.0
Map.quantity | | the degree eta, or the bound on a bias | "A.range"
""",
    "maneuver": """
ManeuverScenario.target | | where the target is, or may be |
ManeuverScenario.observer | | where the observer starts and how it can move |
ManeuverScenario.bearings | | how many, how often, how good |
ManeuverScenario.sensors | | what is measured instead of bearings alone |
ManeuverScenario.limits | | what the path keeps clear of |
ManeuverScenario.goal | | what is to be made best |
ManeuverScenario.prior | m, m/s | what is known of the target, standard deviations | { x = 1000.0, y = 1000.0 }
ManeuverScenario.closed_loop | | fly it without knowing the target |
Target.position | m | at the first bearing: east, north | [0.0, 1000.0]
Target.positions | m | several possible places instead | [[0.0, 1000.0], [500.0, 900.0]]
Target.weights | | how likely each place is | [0.7, 0.3]
Target.velocity | m/s | of a target that moves | [-5.0, 5.0]
Observer.start | m | at the first bearing: east, north | [0.0, 0.0]
Observer.starts | m | of several observers instead | [[0.0, 0.0], [600.0, 0.0]]
Observer.separation | m | how near to each other they measure at least | 300.0
Observer.return_to | m | where the path ends: east, north, and within which radius | [0.0, 0.0, 100.0]
Observer.max_distance | m | the longest path through the water | 5000.0
Observer.current | m/s | velocity of the water | [0.5, 0.0]
Observer.speed | m/s | one, or the lowest and the highest | [10.0, 20.0]
Observer.heading_deg | deg | before the first leg, clockwise from north | 45.0
Observer.max_turn_rate_deg | deg/s | the fastest turn | 12.0
Observer.legs | | a path of so many straight legs | 2
SensorSection.kind | | what it measures | "range_rate"
SensorSection.sigma | unit of the kind: m, m/s, Hz, dB | standard deviation of a reading | 0.5
SensorSection.sigma_deg | deg | the same for an angle | 1.0
SensorSection.detection | | probability of a reading | 0.8
SensorSection.bias | | name of an unknown bias | "compass"
SensorSection.blind_deg | deg | arcs from the heading in which nothing is seen | [[150.0, 210.0]]
SensorSection.reach | m | nothing is seen beyond | 8000.0
SensorSection.parameters | | tonal and wave; power and exponent | { tonal = 300.0 }
SensorSection.unknown | | which of them are states, and their names | { tonal = "f0" }
Bearings.count | | how many, the first at the start | 100
Bearings.step | s | from one to the next | 1.0
Bearings.sigma_deg | deg | standard deviation of a bearing | 1.8
Limits.standoff | m | bearings are taken no closer to the target | 500.0
Limits.keep_out | m | discs that are not entered: east, north, radius | [[-350.0, 450.0, 120.0]]
Limits.polygons | m | outlines of areas that are not entered | [[[0.0, 500.0], [100.0, 500.0], [50.0, 600.0]]]
Goal.criterion | | determinant, trace or largest axis of the covariance | "A"
Goal.combination | | what is to be known best: "range", "bearing", "speed", "course", or a number for each state | "range"
Goal.accuracy | m, m/s, rad | the standard deviation of that combination to reach in as few samples as possible, `count` at most | 50.0
Goal.interval | | instead: of what the likelihood interval is to be shortest, a state, "range" or "range at the end" | "range"
Goal.over | | the expectation over several possible targets, or the worst of them | "worst"
Goal.chance | | instead: what the criterion is at least as good as with this probability | 0.9
Goal.starts | | how many starts the search has | 24
Goal.restarts | | how often the best paths are disturbed and refined again | 32
Goal.time_limit | s | after which the best path so far is taken | 10.0
Goal.bound | | whether to compute what no path can exceed | false
Goal.seed | | of the starts | 0
Loop.first_range | m | what is thought of the range: mean, standard deviation | [1500.0, 500.0]
Loop.first_speed | m/s | standard deviation of each component of a moving target's velocity | 5.0
Loop.methods | | what flies | ["plan", "max_det"]
Loop.trials | | how many flights of each | 40
Loop.seed | | of the noise | 0
Loop.lost | | probability that a bearing is lost | 0.2
Loop.when_lost | | what the observer does then | "hold"
Loop.false_alarms | | probability that a sample brings a false bearing | 0.1
Loop.opening | | so many bearings at right angles to the first one, before the method takes over | 5
Loop.replan | | bearings from one plan to the next | 15
Loop.horizon | | bearings that are planned ahead, all by default | 40
""",
    "tracks": """
TracksScenario.motion | | how the target moves |
TracksScenario.carriers | | what the sensors are on |
TracksScenario.sensors | | what is seen |
TracksScenario.target | m, m/s | the state, by the names that `gramian analyze` prints | { x0 = 2500.0, y0 = 3500.0 }
TracksScenario.prior | as the state | a standard deviation about the target's state, or mean and standard deviation | { x0 = 1000.0 }
TracksScenario.known | as the state | what is known exactly | { tonal = 300.0 }
TracksScenario.measurements | | what was measured, for `localize` |
TracksScenario.loss | | whether outliers are held back | "huber"
Moves.kind | | the motion | "legs"
Moves.dimension | | of the space | 3
Moves.turns | s | known times of the turns between legs | [600.0]
Moves.count | | number of legs, whose turns are unknown; "auto" lets `localize` choose | 2
Moves.constant_speed | | whether all legs have one speed | true
Borne.name | | by which sensors name it | "ship"
Borne.path | m | its positions | [[0.0, 0.0], [3000.0, 0.0]]
Borne.times | s | of the positions | [0.0, 600.0]
Borne.place | m | where it stands, in place of a path | [0.0, 0.0]
Borne.heading_deg | deg | of a carrier that stands still, clockwise from north | 90.0
Seen.kind | | what it measures | "bearing"
Seen.name | | in messages and in the file of measurements; by default the kind | "sonar"
Seen.carrier | | what it is on | "ship"
Seen.second | | the other carrier of a difference | "buoy"
Seen.times | s | of its samples | { first = 5.0, last = 1205.0, step = 20.0 }
Seen.sigma | unit of the kind: m, m/s, s, Hz, dB, rad | standard deviation of a sample | 10.0
Seen.sigma_deg | deg | the same for an angle | 0.5
Seen.correlation_time | s | of Gauss-Markov noise | 60.0
Seen.bias | unit of the kind | added to the reading: the name of a state, or a value | "compass"
Seen.scale | | the reading is multiplied by 1 + scale: likewise | "log"
Seen.clock | s | stamp less true time: likewise | "clock"
Seen.true_path | | whether the carrier's path has the true time rather than the same stamps | true
Seen.delay | m/s | speed of the wave: the target is seen where it was | 1500.0
Seen.detection | | probability of a sample | 0.9
Seen.speed | m/s | of the wave, for frequencies and differences of time | 1500.0
Seen.tonal | Hz | the emitted frequency: the name of a state, or a value | "tonal"
Seen.power | dB | at 1 m: likewise | "power"
Seen.exponent | | of the loss with distance: likewise | 2.0
Seen.clocks | s | clock offsets of both carriers: names of states | ["clock_a", "clock_b"]
Steps.first | s | the first time | 5.0
Steps.last | s | the last time | 1205.0
Steps.step | s | from one to the next | 20.0
Measured.file | | a table with columns sensor, value (value_2, value_3), a line for each sample in order of time | "measured.csv"
""",
}


@cache
def _table(model: str) -> dict[str, Key]:
    lines = [line.split("|") for line in KEYS[model].splitlines() if line.strip()]
    return {
        name.strip(): (unit.strip(), meaning.strip(), example.strip())
        for name, unit, meaning, example in lines
    }


def key_of(model: str, classes: tuple[type, ...], field: str) -> Key | None:
    """Return what is said of a field of a class, or of one that it inherits from."""
    if field == "model":
        return "", "which model the file is of", f'"{model}"'
    table = _table(model)
    found = (table.get(f"{kind.__name__}.{field}") for kind in classes)
    return next((key for key in found if key is not None), None)
