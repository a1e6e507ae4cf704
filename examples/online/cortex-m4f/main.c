/* The exported tracker on a Cortex-M4F, in qemu's board mps2-an386; single precision for every sample.
 *
 *     vibrident export result.json --format c --online --rate 20000 --out .
 *     arm-none-eabi-gcc -std=c99 -O2 -mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard -DSENSOR_FLOAT \
 *         --specs=rdimon.specs -nostartfiles -T mps2-an386.ld -o track.elf main.c sensor.c -lm
 *     qemu-system-arm -M mps2-an386 -nographic -semihosting -icount shift=0 -kernel track.elf
 *
 * Reads samples.f32 (float32, reference and response in turn) from the host's folder and writes state.bin there, the
 * saved state, which the Python tracker restores. SysTick runs at 25 MHz; with -icount shift=0 qemu takes one
 * nanosecond an instruction, so a tick is 40 of them.
 */
#include "sensor.h"

#include <stdint.h>
#include <stdio.h>

#define PIECE 1024
#define PAINT 0xA5A5A5A5u
#define INSTRUCTIONS_A_TICK 40.0
#define SYSTICK ((volatile uint32_t *)0xE000E010u) /* control, reload, value */

extern uint32_t stack_low[], stack_top[];
extern void initialise_monitor_handles(void), _exit(int);

static sensor_tracker tracker;
static float samples[PIECE][2];
static unsigned char saved[SENSOR_SAVED];

static void say(void) {
    double value[SENSOR_PARAMETERS], u[SENSOR_PARAMETERS];
    int excited[SENSOR_PARAMETERS], i;
    sensor_finish(&tracker);
    (void)sensor_read(&tracker, value, u, excited);
    for (i = 0; i < SENSOR_PARAMETERS; i++) printf("parameter %d %.9g %.4g\n", i, value[i], u[i]);
    for (i = 0; i < tracker.alarms; i++)
        printf("alarm %d %.6f %.9g %.9g\n", tracker.alarm[i].parameter, tracker.alarm[i].time_s, tracker.alarm[i].before,
               tracker.alarm[i].after);
}

int main(void) {
    FILE *source = fopen("samples.f32", "rb"), *target;
    double ticks = 0.0;
    uint32_t *free_word, most = 0;
    unsigned long count = 0;
    size_t got, i;
    if (source == NULL) return 1;
    for (free_word = stack_low; free_word < (uint32_t *)__builtin_frame_address(0) - 64; free_word++) *free_word = PAINT;
    SYSTICK[1] = 0xFFFFFFu;
    SYSTICK[0] = 5u; /* on, the processor's clock */
    sensor_init(&tracker);
    while ((got = fread(samples, sizeof samples[0], PIECE, source)) > 0) {
        for (i = 0; i < got; i++) {
            uint32_t begin = SYSTICK[2], taken;
            (void)sensor_step(&tracker, samples[i][0], samples[i][1]);
            taken = (begin - SYSTICK[2]) & 0xFFFFFFu;
            ticks += taken;
            if (taken > most) most = taken;
        }
        count += got;
    }
    for (free_word = stack_low; *free_word == PAINT; free_word++) continue;
    say();
    printf("instructions %.0f a sample, %.0f at most\n", ticks * INSTRUCTIONS_A_TICK / count, most * INSTRUCTIONS_A_TICK);
    printf("ram %u tracker, %u stack\n", (unsigned)sizeof tracker, (unsigned)((stack_top - free_word) * 4));
    target = fopen("state.bin", "wb");
    if (target == NULL || fwrite(saved, 1, sensor_save(&tracker, saved), target) == 0) return 1;
    (void)fclose(target);
    return 0;
}

/* The vector table's two entries that are needed: the stack, and this. */
void reset(void) {
    int status;
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* the floating-point unit on */
    __asm volatile("dsb\n isb");
    initialise_monitor_handles();
    status = main();
    (void)fflush(NULL);
    _exit(status);
}
typedef struct {
    uint32_t *stack;
    void (*reset)(void);
} vector_table;
__attribute__((section(".vectors"), used)) static const vector_table vectors = {stack_top, reset};
