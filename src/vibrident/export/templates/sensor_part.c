
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
