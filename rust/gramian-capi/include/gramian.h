/* C interface of gramian: written by cbindgen from src/lib.rs, do not edit.
 * SI units and radians; x east, y north; bearings clockwise from north.
 * No function allocates, keeps a pointer or prints. */

#ifndef GRAMIAN_H
#define GRAMIAN_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

// What a call came to.
typedef enum GramianStatus {
  // Done.
  GRAMIAN_STATUS_OK = 0,
  // A pointer is null.
  GRAMIAN_STATUS_NULL,
  // A number is NaN or infinite.
  GRAMIAN_STATUS_NOT_FINITE,
  // A time is not later than the one before.
  GRAMIAN_STATUS_TIME,
  // A standard deviation or weight is not positive.
  GRAMIAN_STATUS_SIGMA,
  // A range is not positive, or the dipole is on the sensor.
  GRAMIAN_STATUS_RANGE,
  // A step is not positive, or longer than the law allows at this range.
  GRAMIAN_STATUS_STEP,
  // Only some of the bearings come with a range.
  GRAMIAN_STATUS_MIXED,
  // All numbers are finite, but what follows from them is too large for a float.
  GRAMIAN_STATUS_OVERFLOW,
} GramianStatus;

// Which way to steer; see `gramian_heading`.
typedef enum GramianLaw {
  // The largest determinant of the two next bearings: step <= range.
  GRAMIAN_LAW_MAX_DET = 0,
  // The law of Hammel and Liu: step <= range.
  GRAMIAN_LAW_HAMMEL_LIU,
  // The largest change of bearing, the tangent: step <= range.
  GRAMIAN_LAW_BEARING_RATE,
  // Perpendicular to the line of sight now.
  GRAMIAN_LAW_PERPENDICULAR,
  // The circle about the target, a chord of it: step <= 2 range.
  GRAMIAN_LAW_CIRCLE,
} GramianLaw;

// To which side of the line of sight.
typedef enum GramianSide {
  // Clockwise.
  GRAMIAN_SIDE_RIGHT = 0,
  // Anticlockwise.
  GRAMIAN_SIDE_LEFT,
} GramianSide;

// What a tracker is told.
typedef enum GramianSensor {
  // A bearing clockwise from north, rad.
  GRAMIAN_SENSOR_BEARING = 0,
  // A range, m.
  GRAMIAN_SENSOR_RANGE,
  // The rate of the range, m/s.
  GRAMIAN_SENSOR_RANGE_RATE,
} GramianSensor;

// A bearings monitor. Its content is private: make it with
// `gramian_monitor_init` before any other use. It may be copied.
typedef struct GramianMonitor {
  uint64_t content[32];
} GramianMonitor;

// What the bearings so far say. Infinity in a bound: there is none.
typedef struct GramianAnswer {
  // How many bearings there are.
  uint32_t count;
  // Rank of 4: below it the track is not observable.
  uint32_t rank;
  // Logarithm of the determinant of the information.
  float log_determinant;
  // Smallest singular value of the rows with unit columns.
  float singular_value;
  // Bounds on x0, y0, vx, vy at the first time.
  float crlb_std[4];
  // Statistic of the test of noisy bearings, and its degrees of freedom.
  float statistic;
  // Degrees of freedom of the statistic.
  float dof;
  // Probability of a statistic as large where the track is not observable.
  float p_value;
} GramianAnswer;

// The running Fisher information of a dipole's pass. Its content is private:
// make it with `gramian_dipole_sums_init` before any other use.
typedef struct GramianDipoleSums {
  uint64_t content[24];
} GramianDipoleSums;

// The estimate of a target at constant velocity while measurements arrive. Its content
// is private: make it with `gramian_tracker_init` before any other use. It may be copied.
typedef struct GramianTracker {
  uint64_t content[16];
} GramianTracker;

// What the measurements of a tracker so far say.
typedef struct GramianTrack {
  // x0, y0, vx, vy at time 0: m, m/s.
  float state[4];
  // Their standard deviations.
  float std[4];
  // Sum of the squared innovations, chi-square with `count` degrees of freedom.
  float chi2;
  // Probability of one as large where the target keeps its velocity.
  float p_value;
  // How many measurements there are.
  uint32_t count;
  // 1 where the innovations have drifted: the target has turned.
  uint32_t alarm;
} GramianTrack;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Makes a monitor that has seen nothing.
//
// # Safety
// `monitor` is null or points to memory for a monitor.
enum GramianStatus gramian_monitor_init(struct GramianMonitor *monitor);

// Takes in a bearing (s, rad, rad). `range` (m) is the target's distance as far
// as it is known, for all bearings or none: 0 where it is not.
//
// # Safety
// `monitor` is null or was made by `gramian_monitor_init`.
enum GramianStatus gramian_monitor_push(struct GramianMonitor *monitor,
                                        float time,
                                        float bearing,
                                        float sigma,
                                        float range);

// Says what the bearings so far determine.
//
// # Safety
// `monitor` is null or was made by `gramian_monitor_init`; `answer` is null or
// points to memory for an answer.
enum GramianStatus gramian_monitor_answer(const struct GramianMonitor *monitor,
                                          struct GramianAnswer *answer);

// Gives the heading of the next leg, in (-pi, pi], clockwise from north
// (rad, m).
//
// # Safety
// `heading` is null or points to a float.
enum GramianStatus gramian_heading(float bearing,
                                   float range,
                                   float step,
                                   enum GramianLaw law,
                                   enum GramianSide side,
                                   float *heading);

// Gives the field (T) at the sensor of a dipole of `moment` (A m^2) at `position`
// (m) from it.
//
// # Safety
// Each pointer is null or points to three floats.
enum GramianStatus gramian_dipole_field(const float *position, const float *moment, float *field);

// Gives the derivatives of the field by position and by moment, row by row.
//
// # Safety
// Each pointer is null or points to three floats, or nine for the results.
enum GramianStatus gramian_dipole_jacobian(const float *position,
                                           const float *moment,
                                           float *by_position,
                                           float *by_moment);

// Makes sums that hold no information.
//
// # Safety
// `sums` is null or points to memory for sums.
enum GramianStatus gramian_dipole_sums_init(struct GramianDipoleSums *sums);

// Adds one sample of a three-axis sensor with standard deviation `sigma` (T): the
// dipole is at `position`, `time` (s) after the instant of the state (r0, v, m).
//
// # Safety
// `sums` is null or was made by `gramian_dipole_sums_init`; the others are null or
// point to three floats.
enum GramianStatus gramian_dipole_sums_push(struct GramianDipoleSums *sums,
                                            float time,
                                            const float *position,
                                            const float *moment,
                                            float sigma);

// Gives the information on (r0, v, m), 9 x 9, row by row.
//
// # Safety
// `sums` is null or was made by `gramian_dipole_sums_init`; `matrix` is null or
// points to 81 floats.
enum GramianStatus gramian_dipole_sums_matrix(const struct GramianDipoleSums *sums, float *matrix);

// Makes a tracker of a target that is known to these deviations at time 0: x0, y0, vx,
// vy (m, m/s).
//
// # Safety
// `tracker` is null or points to memory for a tracker; the others are null or point to
// four floats.
enum GramianStatus gramian_tracker_init(struct GramianTracker *tracker,
                                        const float *state,
                                        const float *sigma);

// Takes in a measurement at `time` (s) of a sensor at `place`, which moves at
// `velocity` (m, m/s: east, north).
//
// # Safety
// `tracker` is null or was made by `gramian_tracker_init`; `place` and `velocity` are
// null or point to two floats.
enum GramianStatus gramian_tracker_push(struct GramianTracker *tracker,
                                        enum GramianSensor sensor,
                                        float time,
                                        float reading,
                                        float sigma,
                                        const float *place,
                                        const float *velocity);

// Multiplies what is known by `keep`, in (0, 1], and takes the alarm back.
//
// # Safety
// `tracker` is null or was made by `gramian_tracker_init`.
enum GramianStatus gramian_tracker_forget(struct GramianTracker *tracker, float keep);

// Says what the measurements so far determine.
//
// # Safety
// `tracker` is null or was made by `gramian_tracker_init`; `track` is null or points to
// memory for one.
enum GramianStatus gramian_tracker_answer(const struct GramianTracker *tracker,
                                          struct GramianTrack *track);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* GRAMIAN_H */
