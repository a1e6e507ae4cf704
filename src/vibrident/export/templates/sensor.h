/*
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
