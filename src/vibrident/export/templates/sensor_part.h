
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
