/* A bearings monitor in C: reads "time bearing sigma" lines (s, rad, rad) and says
 * when the track becomes observable.
 *
 *     cc monitor.c -I rust/gramian-capi/include libgramian_capi.a -lm
 */
#include <stdio.h>

#include "gramian.h"

int main(void) {
  GramianMonitor monitor;
  GramianAnswer answer;
  float time, bearing, sigma;
  int observable = 0;

  gramian_monitor_init(&monitor);
  while (scanf("%f %f %f", &time, &bearing, &sigma) == 3) {
    GramianStatus status = gramian_monitor_push(&monitor, time, bearing, sigma, 0.0f);
    if (status != GRAMIAN_STATUS_OK) {
      printf("%g s: refused, status %d\n", time, (int)status);
      continue;
    }
    gramian_monitor_answer(&monitor, &answer);
    if (!observable && answer.p_value < 0.001f) {
      observable = 1;
      printf("%g s: observable after %u bearings\n", time, answer.count);
    }
  }
  gramian_monitor_answer(&monitor, &answer);
  printf("%u bearings: rank %u, %s\n", answer.count, answer.rank,
         observable ? "observable" : "not observable");
  float heading;
  if (gramian_heading(0.0f, 1000.0f, 20.0f, GRAMIAN_LAW_MAX_DET, GRAMIAN_SIDE_RIGHT,
                      &heading) == GRAMIAN_STATUS_OK)
    printf("steer %.4f rad\n", heading);
  return 0;
}
