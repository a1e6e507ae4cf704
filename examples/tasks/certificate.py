"""Issue a certificate: state the measuring chain, see what is missing, write the PDF."""

import vibrident

tones = [100, 160, 400, 650]
simulated = vibrident.simulate(frequencies_hz=tones, samples=2000, response_noise=1e-3)
calibration = vibrident.Calibration.from_arrays(
    [record.reference for record in simulated.records],
    [record.response for record in simulated.records],
    simulated.records[0].sampling_rate_hz,
    sensor={"type": "A-630", "serial_number": "0042"},
    effects=[
        vibrident.SystematicEffect("laser vibrometer, certificate L-3", "gain", 1e-3),
        vibrident.SystematicEffect("phase of the amplifier", "phase", 9e-4),
    ],
)
result = vibrident.identify(calibration)
entries = {"number": "2026-0042", "laboratory": "Laboratory of an example"}
print("missing:", ", ".join(vibrident.check_certificate(result, entries)))
print("written:", vibrident.report(result, "certificate.pdf", certificate=entries))
