"""The C99 text around the numbers: one set of types and functions, written once for each precision.

``@N@`` is the name, ``@S@`` the suffix of the precision, ``@T@`` its type; the rest are numbers.
"""

from __future__ import annotations

HEADER = """/*
@ABOUT@
 */
#ifndef @GUARD@_H
#define @GUARD@_H

#ifdef __cplusplus
extern "C" {
#endif

/* Samples per second that all coefficients belong to. */
#define @GUARD@_RATE_HZ @RATE@
/* Samples by which the outputs are late. */
#define @GUARD@_MODEL_LATENCY @MODEL_LATENCY@
#define @GUARD@_CORRECTION_LATENCY @CORRECTION_LATENCY@
/* Second-order sections, taps before them, samples kept. */
#define @GUARD@_MODEL_SECTIONS @MODEL_SECTIONS@
#define @GUARD@_MODEL_TAPS @MODEL_TAPS@
#define @GUARD@_CORRECTION_SECTIONS @CORRECTION_SECTIONS@
#define @GUARD@_CORRECTION_TAPS @CORRECTION_TAPS@
#define @GUARD@_SECTIONS @SECTIONS@
#define @GUARD@_LINE @LINE@
/* States of the cell. */
#define @GUARD@_STATES @STATES@
@BODY@
#ifdef __cplusplus
}
#endif

#endif
"""

DECLARATIONS = """
/* ---- @PRECISION@ ---- */

/* A filter: y = sections(taps(x)). Rows of sections: b0 b1 b2 a1 a2 of
 * (b0 d^2 + b1 d + b2)/(d^2 + a1 d + a2), d = z - 1. */
typedef struct {
    int lead, taps, sections;
    const @T@ *tap;
    const @T@ *section;
} @N@_coefficients@S@;

typedef struct {
    const @N@_coefficients@S@ *coefficients;
    int next;
    @T@ line[@GUARD@_LINE];
    @T@ state[2 * @GUARD@_SECTIONS];
} @N@_filter@S@;

/* The network's cell by first-order hold. */
typedef struct {
    @T@ before;
    @T@ x[@GUARD@_STATES];
} @N@_cell@S@;

extern const @N@_coefficients@S@ @N@_model@S@, @N@_correction@S@;
/* CMSIS-DSP order, {b0, b1, b2, -a1, -a2} a section in z: for arm_biquad_cascade_df2T_@ARM@ and _df1_@ARM@.
 * The taps come before them, first tap first (arm_fir_@ARM@ wants them reversed), after the lead of whole samples. */
extern const @T@ @N@_model_sos@S@[5 * @GUARD@_MODEL_SECTIONS];
extern const @T@ @N@_model_fir@S@[@GUARD@_MODEL_TAPS];
extern const @T@ @N@_correction_sos@S@[5 * @GUARD@_CORRECTION_SECTIONS];
extern const @T@ @N@_correction_fir@S@[@GUARD@_CORRECTION_TAPS];

/* Start a filter at rest: @N@_filter_init@S@(&f, &@N@_model@S@) or (&f, &@N@_correction@S@). */
void @N@_filter_init@S@(@N@_filter@S@ *filter, const @N@_coefficients@S@ *coefficients);
/* One sample: @INPUT@ in, @OUTPUT@ out (model); the other way round (correction). */
@T@ @N@_filter_step@S@(@N@_filter@S@ *filter, @T@ sample);

/* Start the cell at rest. */
void @N@_cell_init@S@(@N@_cell@S@ *cell);
/* One sample through the cell, without latency: @INPUT@ in, @OUTPUT@ out. */
@T@ @N@_cell_step@S@(@N@_cell@S@ *cell, @T@ sample);
"""

SOURCE = """/*
@ABOUT@
 */
#include "@N@.h"
@BODY@"""

DEFINITIONS = """
/* ---- @PRECISION@ ---- */

const @T@ @N@_model_sos@S@[] = {@MODEL_SOS@};
const @T@ @N@_model_fir@S@[] = {@MODEL_FIR@};
const @T@ @N@_correction_sos@S@[] = {@CORRECTION_SOS@};
const @T@ @N@_correction_fir@S@[] = {@CORRECTION_FIR@};

static const @T@ model_section@S@[] = {@MODEL_DELTA@};
static const @T@ correction_section@S@[] = {@CORRECTION_DELTA@};

const @N@_coefficients@S@ @N@_model@S@ = {
    @MODEL_LEAD@, @GUARD@_MODEL_TAPS, @GUARD@_MODEL_SECTIONS, @N@_model_fir@S@, model_section@S@};
const @N@_coefficients@S@ @N@_correction@S@ = {
    @CORRECTION_LEAD@, @GUARD@_CORRECTION_TAPS, @GUARD@_CORRECTION_SECTIONS, @N@_correction_fir@S@,
    correction_section@S@};

/* The cell: x += growth x + before a[k-1] + now a[k];  y = output x + direct a[k].
 * growth = W3 - 1, (before, now) = W1, output = W2, (0, direct) = W4. */
static const @T@ growth@S@[@GUARD@_STATES][@GUARD@_STATES] = {
    @GROWTH@};
static const @T@ before@S@[@GUARD@_STATES] = {@BEFORE@};
static const @T@ now@S@[@GUARD@_STATES] = {@NOW@};
static const @T@ output@S@[@GUARD@_STATES] = {@OUTPUTS@};
static const @T@ direct@S@ = @DIRECT@;

void @N@_filter_init@S@(@N@_filter@S@ *filter, const @N@_coefficients@S@ *coefficients)
{
    int i;
    filter->coefficients = coefficients;
    filter->next = 0;
    for (i = 0; i < @GUARD@_LINE; i++)
        filter->line[i] = 0;
    for (i = 0; i < 2 * @GUARD@_SECTIONS; i++)
        filter->state[i] = 0;
}

@T@ @N@_filter_step@S@(@N@_filter@S@ *filter, @T@ sample)
{
    const @N@_coefficients@S@ *c = filter->coefficients;
    @T@ value = 0;
    int i, at = filter->next - c->lead;
    filter->line[filter->next] = sample;
    filter->next = filter->next + 1 < @GUARD@_LINE ? filter->next + 1 : 0;
    if (at < 0)
        at += @GUARD@_LINE;
    for (i = 0; i < c->taps; i++) {
        value += c->tap[i] * filter->line[at];
        at = at > 0 ? at - 1 : @GUARD@_LINE - 1;
    }
    for (i = 0; i < c->sections; i++) {
        const @T@ *k = c->section + 5 * i;
        @T@ *s = filter->state + 2 * i;
        @T@ in = value;
        value = k[0] * in + s[0];
        s[0] += k[1] * in - k[3] * value + s[1];
        s[1] += k[2] * in - k[4] * value;
    }
    return value;
}

void @N@_cell_init@S@(@N@_cell@S@ *cell)
{
    int i;
    cell->before = 0;
    for (i = 0; i < @GUARD@_STATES; i++)
        cell->x[i] = 0;
}

@T@ @N@_cell_step@S@(@N@_cell@S@ *cell, @T@ sample)
{
    @T@ step[@GUARD@_STATES];
    @T@ value = direct@S@ * sample;
    int i, j;
    for (i = 0; i < @GUARD@_STATES; i++) {
        step[i] = before@S@[i] * cell->before + now@S@[i] * sample;
        for (j = 0; j < @GUARD@_STATES; j++)
            step[i] += growth@S@[i][j] * cell->x[j];
    }
    for (i = 0; i < @GUARD@_STATES; i++) {
        cell->x[i] += step[i];
        value += output@S@[i] * cell->x[i];
    }
    cell->before = sample;
    return value;
}
"""
