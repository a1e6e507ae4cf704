/*
@ABOUT@
 */
#ifndef @GUARD@_ONLINE_H
#define @GUARD@_ONLINE_H
#ifdef __cplusplus
extern "C" {
#endif
/* Type of what is done for every sample; blocks are computed in double. */
#ifdef @GUARD@_FLOAT
typedef float @N@_real;
#else
typedef double @N@_real;
#endif
#define @GUARD@_RATE_HZ @RATE@
#define @GUARD@_PARAMETERS @P@
#define @GUARD@_INPUTS @Q@
#define @GUARD@_ORDER 2 /* states of the cell */
#define @GUARD@_M (3 + @P@) /* unknowns: states, offset, parameters */
#define @GUARD@_CELL (2 * (3 + @P@)) /* states and their sensitivities */
#define @GUARD@_AR @AR@
#define @GUARD@_BLOCK @BLOCK@
#define @GUARD@_PARTS @PARTS@ /* a block is of 2 to this power samples */
#define @GUARD@_LEVELS @LEVELS@
#define @GUARD@_TAPS @TAPS@
#define @GUARD@_REFERENCES @REFERENCES@ /* samples that wait, at most */
#define @GUARD@_RESPONSES @RESPONSES@
#define @GUARD@_CORRECTOR_TAPS @CORRECTOR_TAPS@
#define @GUARD@_CORRECTOR_LATENCY @CORRECTOR_LATENCY@
#define @GUARD@_ALARMS 8 /* kept until they are taken; further ones replace the last */
/* Bytes of a saved state, at most. */
#define @GUARD@_SAVED (20 + 8 * (@NUMBERS@ + @GUARD@_REFERENCES + @GUARD@_RESPONSES))

/* Places of the parameters: @NAMES@. An alarm of the innovation has the place @GUARD@_PARAMETERS. */
typedef struct {
    int parameter, passed; /* passed: of the innovation, a disturbance that has passed */
    double time_s, detected_s, before, after, u;
} @N@_alarm;

/* What is carried from sample to sample; the names are those of the Python tracker's state. */
typedef struct {
    double point[@GUARD@_M], known[@GUARD@_M][@GUARD@_M + 1], own[4 + @GUARD@_AR], whitening[@GUARD@_AR], noise[6];
    double lags[3 + @GUARD@_AR], clock[11], row[(@GUARD@_M + 1) * (@GUARD@_M + 1) + 2], pending[7];
    double before[@GUARD@_M][@GUARD@_M + 1], ladder_known[@GUARD@_LEVELS][@GUARD@_M][@GUARD@_M + 1];
    double ladder_gram[@GUARD@_LEVELS][@GUARD@_M + 1][@GUARD@_M + 1], ladder_meta[@GUARD@_LEVELS][7];
    @N@_real cell[@GUARD@_CELL], rows[@GUARD@_AR][@GUARD@_M + 1];
    @N@_real part[@GUARD@_PARTS + 1][(@GUARD@_M + 1) * (@GUARD@_M + 2) / 2];
    /* the cell at the point of linearisation */
    @N@_real phi[2][2], gamma[2][@GUARD@_INPUTS], c[2], d[@GUARD@_INPUTS];
    @N@_real d_phi[@P@][2][2], d_gamma[@P@][2][@GUARD@_INPUTS], d_c[@P@][2], d_d[@P@][@GUARD@_INPUTS];
    @N@_real white[@GUARD@_AR];
    /* of segments of 1, 2, 4, ... rows: squared score and squares from which one is tested, and the less of them */
    @N@_real limit[@GUARD@_PARTS], louder[@GUARD@_PARTS], least[@GUARD@_PARTS];
    /* samples that wait, twice, so that a window is in one piece */
    @N@_real reference[2 * @GUARD@_REFERENCES], response[2 * @GUARD@_RESPONSES];
    unsigned row_next;
    int tests, whitens, references, reference_next, responses, response_next;
    /* the corrector's line and coefficients */
    @N@_real line[2 * @GUARD@_CORRECTOR_TAPS], coefficient[3];
    @N@_alarm alarm[@GUARD@_ALARMS];
    int line_next, alarms;
} @N@_tracker;

/* Start at the certificate, at time 0. */
void @N@_init(@N@_tracker *t);
/* A run of samples begins: its first is of this time. The parameters stay. */
void @N@_begin(@N@_tracker *t, double time_s);
/* One sample of each channel, @INPUT@ and @OUTPUT@; one that is not a number is a gap. Returns the alarms that
 * wait. */
int @N@_step(@N@_tracker *t, @N@_real reference, @N@_real response);
/* No sample follows: take the block under way. */
void @N@_finish(@N@_tracker *t);
/* Whether a change is certain that is not named yet. */
int @N@_changing(const @N@_tracker *t);
/* Values and standard uncertainties; whether the motion since the last reading told each by itself. Returns the rms
 * of the innovation since then, negative where nothing moved. */
double @N@_read(@N@_tracker *t, double value[@P@], double u[@P@], int excited[@P@]);
/* The acceleration @GUARD@_CORRECTOR_LATENCY samples ago, with the parameters of the moment. */
@N@_real @N@_correct(@N@_tracker *t, @N@_real response);
/* The state as bytes, with a CRC-32; returns their number. The Python tracker reads and writes the same. */
unsigned long @N@_save(const @N@_tracker *t, unsigned char *bytes);
/* Take a saved state over, into a tracker that was started; 0 where it is damaged or not of this file's kind. */
int @N@_restore(@N@_tracker *t, const unsigned char *bytes, unsigned long size);

#ifdef __cplusplus
}
#endif
#endif
