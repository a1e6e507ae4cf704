/* Samples from standard input through an exported tracker: a line of reference and response each; "nan" is a gap.
 *
 *     vibrident export result.json --format c --online --rate 20000 --out .
 *     gcc -std=c99 -O3 -o track main.c sensor.c -lm
 *     ./track < samples.txt
 */
#include "sensor.h"

#include <stdio.h>

static sensor_tracker tracker;

static void say(long sample) {
    double value[SENSOR_PARAMETERS], u[SENSOR_PARAMETERS];
    int excited[SENSOR_PARAMETERS], i;
    double rms = sensor_read(&tracker, value, u, excited);
    printf("%ld", sample);
    for (i = 0; i < SENSOR_PARAMETERS; i++) printf(" %.9g %.3g%s", value[i], u[i], excited[i] ? "*" : "");
    printf(" %.4g\n", rms);
}

int main(void) {
    double reference, response;
    long sample = 0;
    int said = 0, changing = 0;
    sensor_init(&tracker);
    while (scanf("%lf %lf", &reference, &response) == 2) {
        int alarms = sensor_step(&tracker, (sensor_real)reference, (sensor_real)response);
        if (sensor_changing(&tracker) && !changing) printf("changing: certain at sample %ld\n", sample);
        changing = sensor_changing(&tracker);
        for (; said < alarms; said++) {
            const sensor_alarm *alarm = &tracker.alarm[said];
            printf("alarm: parameter %d at %.6f s: %.9g to %.9g, u %.3g\n", alarm->parameter, alarm->time_s, alarm->before,
                   alarm->after, alarm->u);
        }
        if (++sample % (long)SENSOR_RATE_HZ == 0) say(sample);
    }
    sensor_finish(&tracker);
    say(sample);
    return 0;
}
