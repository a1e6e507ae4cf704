"""What the heads of text files state is handed on: units, rates and starts, in the layouts of makers and of people.

Each file is synthetic and imitates a layout as its maker documents it.
"""

from dataclasses import dataclass, field

import numpy as np
import pytest

from vibrident.data.io.columns import StartTime
from vibrident.data.io.formats.csv import CsvFile

COUNT = 40
ACC = [round(0.5 * n - 7.25, 3) for n in range(COUNT)]
VOLT = [round(0.125 * (n % 7) - 0.25, 4) for n in range(COUNT)]
NS_2026 = 1_795_341_600_000_000_000  # 2026-11-22T10:00:00Z


def table(*columns, gap=",", decimal=".", after="", begin="", end="\n") -> str:
    rows = zip(*columns, strict=True)
    lines = [begin + gap.join(str(v).replace(".", decimal) for v in row) + after for row in rows]
    return end.join(lines) + end


def times(interval, start=0.0, form="{:.9g}"):
    return [form.format(start + interval * n) for n in range(COUNT)]


@dataclass(frozen=True)
class Expected:
    names: tuple[str, ...]
    units: tuple[str, ...]
    rate_hz: float | None
    columns: dict[int, list] = field(default_factory=dict)
    start: StartTime | None = None
    at: int = 1  # the column whose rate and start are compared


LABVIEW = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
    "Multi_Headings\t{multi}\nX_Columns\t{x}\nTime_Pref\tRelative\nOperator\tN.N.\nDate\t2026/11/22\n"
    "Time\t09:59:59.5\n***End_of_Header***\t\n\t\n"
)
SEGMENT = (
    "Channels\t2\t\t\nSamples\t{count}\t{count}\t\nDate\t2026/11/22\t2026/11/22\t\nTime\t{time}\t{time}\t\n"
    "Y_Unit_Label\tg\tmV\t\nX_Dimension\tTime\tTime\t\nX0\t{x0}\t{x0}\t\n"
    "Delta_X\t9.765625E-5\t9.765625E-5\t\n***End_of_Header***\t\t\t\nX_Value\tacc\tvolt\tComment\n"
)


def segment(x0="0.0000000000000000E+0", time="10:00:00.125", count=COUNT):
    return SEGMENT.format(x0=x0, time=time, count=count)


MAKERS = {
    "LabVIEW, no X column": (
        LABVIEW.format(multi="No", x="No") + segment() + table(ACC, VOLT, gap="\t", begin="\t"),
        Expected(
            ("X_Value", "acc", "volt"), ("", "g", "mV"), 10240.0, {1: ACC, 2: VOLT},
            StartTime(NS_2026 + 125_000_000, epoch=True),
        ),
    ),
    "LabVIEW, one X column, a remark in the first row": (
        LABVIEW.format(multi="No", x="One") + segment("1.0E-3")
        + table(times(9.765625e-5), ACC, VOLT, gap="\t").replace("\n", "\tshaker on, gain 10\n", 1),
        Expected(
            ("X_Value", "acc", "volt"), ("", "g", "mV"), 10240.0, {1: ACC, 2: VOLT},
            StartTime(NS_2026 + 126_000_000, epoch=True),
        ),
    ),
    "LabVIEW, an X column each, decimal commas": (
        LABVIEW.format(multi="No", x="Multi").replace("Separator\t.", "Separator\t,")
        + "Channels\t2\t\t\t\nSamples\t40\t\t40\t\nDate\t2026/11/22\t\t2026/11/22\t\nTime\t10:00:00,5\t\t10:00:00,5\t\n"
        "Y_Unit_Label\tm/s^2\t\tVolts\t\nX_Dimension\tTime\t\tTime\t\nX0\t0,0\t\t0,0\t\n"
        "Delta_X\t1,0E-3\t\t1,0E-3\t\n***End_of_Header***\t\t\t\t\nX_Value\tacc\tX_Value\tvolt\tComment\n"
        + table(times(1e-3), ACC, times(1e-3), VOLT, gap="\t", decimal=","),
        Expected(
            ("X_Value", "acc", "X_Value", "volt"), ("", "m/s^2", "", "Volts"), 1000.0, {1: ACC, 3: VOLT},
            StartTime(NS_2026 + 500_000_000, epoch=True), at=3,
        ),
    ),
    "LabVIEW, three segments": (
        LABVIEW.format(multi="Yes", x="No")
        + "".join(
            segment(f"{9.765625e-5 * COUNT * n:.10E}") + table(ACC, VOLT, gap="\t", begin="\t") + "\t\n"
            for n in range(3)
        ),
        Expected(
            ("X_Value", "acc", "volt"), ("", "g", "mV"), 10240.0, {1: ACC * 3, 2: VOLT * 3},
            StartTime(NS_2026 + 125_000_000, epoch=True),
        ),
    ),
    "Rigol": (
        "X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,-6.000000e-03,1.000000e-06\n"
        + table(range(COUNT), ACC, VOLT, after=","),
        Expected(
            ("X", "CH1", "CH2"), ("Sequence", "Volt", "Volt"), 1e6, {1: ACC, 2: VOLT},
            StartTime.on_own_clock(-6e-3),
        ),
    ),
    "Rigol, empty cells below the keys": (
        "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-0.006,2.0E-06,\n"
        + table(range(COUNT), ACC, VOLT, after=",,"),
        Expected(
            ("X", "CH1", "CH2"), ("Sequence", "Volt", "Volt"), 5e5, {1: ACC}, StartTime.on_own_clock(-6e-3)
        ),
    ),
    "Rigol, keys beside values": (
        "CH1V,CH2V,t0 =-5.000000e-04, tInc = 2.000000e-09,\n" + table(ACC, VOLT, after=",,"),
        Expected(("CH1V", "CH2V"), ("", ""), 5e8, {0: ACC, 1: VOLT}, StartTime.on_own_clock(-5e-4)),
    ),
    "Siglent": (
        "Record Length,Analog:40\nSample Interval,2.0E-06\nVertical Units,V\nVertical Scale,1.00\n"
        "Vertical Offset,0.00\nHorizontal Units,s\nHorizontal Scale,1.0E-04\nModel Number,SDS1104X-E\n"
        "Serial Number,SDSMM000\nSoftware Version,8.2.6.1.37R9\nSource,CH1\nSecond,Value\n"
        + table(times(2e-6, -4e-5), VOLT),
        Expected(("Second", "Value"), ("", "V"), 5e5, {1: VOLT}),
    ),
    "Siglent, two channels": (
        "Record Length,Analog:40\nSample Rate,500000.0\nVertical Scale,CH1:0.05,CH2:0.05\n"
        "Vertical Offset,CH1:0.00000,CH2:0.00000\nHorizontal Scale,0.000010000\n"
        "Source,CH1,CH2\nSecond,Volt,Volt\n" + table(times(2e-6), ACC, VOLT),
        Expected(("Source", "CH1", "CH2"), ("Second", "Volt", "Volt"), 5e5, {1: ACC, 2: VOLT}),
    ),
    "Tektronix TDS, TPS": (
        "".join(
            f"{head},{t},{v},\n"
            for head, t, v in zip(
                [
                    *("Record Length,2.500000e+03,", "Sample Interval,4.000000e-06,", "Trigger Point,1.25e+03,"),
                    *(",,", ",,", ",,", "Source,CH1,", "Vertical Units,mV,", "Vertical Scale,5.0e-01,"),
                    *("Vertical Offset,0.0,", "Horizontal Units,s,", "Horizontal Scale,1.0e-03,"),
                    *("Pt Fmt,Y,", "Yzero,0.0,", "Probe Atten,1.0,", "Model Number,TPS2014,"),
                    *("Serial Number,C010000,", "Firmware Version,FV:v1.10,"),
                    *([",,"] * (COUNT - 18)),
                ],
                times(4e-6, -5e-3, " {:.9f}"),
                ACC,
                strict=True,
            )
        ),
        Expected(("",) * 5, ("", "", "", "", "mV"), 250e3, {4: ACC}, at=4),
    ),
    "Tektronix TBS, the unit in a cell of its own": (
        "".join(
            f"{head},{t},{v}\n"
            for head, t, v in zip(
                ['"Record Length",2500,"Points"', '"Sample Interval",4e-06,s'] + [",,"] * (COUNT - 2),
                times(4e-6, -5e-3),
                ACC,
                strict=True,
            )
        ),
        Expected(("",) * 5, ("",) * 5, 250e3, {4: ACC}, at=4),
    ),
    "Tektronix MSO, DPO": (
        "Model,MSO64\nFirmware Version,1.28\n,\nPoint Format,Y\nHorizontal Units,s\nHorizontal Scale,4e-05\n"
        "Horizontal Delay,0\nSample Interval,4e-10\nRecord Length,40\nGating,0.0% to 100.0%\n"
        "Probe Attenuation,1,1\nVertical Units,V,A\nVertical Offset,0,0\nVertical Scale,1,1\nVertical Position,0,0\n"
        ",,\n,,\nLabel,,\nTIME,CH1,CH2\n" + table(times(4e-10, -8e-9), ACC, VOLT),
        Expected(("TIME", "CH1", "CH2"), ("", "V", "A"), 2.5e9, {1: ACC, 2: VOLT}),
    ),
    "Keysight": (
        "x-axis,1,2\nsecond,Volt,Volt\n" + table(times(1e-6, -2e-5, "{:+.8E}"), ACC, VOLT),
        Expected(("x-axis", "1", "2"), ("second", "Volt", "Volt"), None, {1: ACC, 2: VOLT}),
    ),
    "PicoScope": (
        "Time,Channel A,Channel B\r\n(ms),(V),(mV)\r\n\r\n" + table(times(1e-3, form="{:.8f}"), ACC, VOLT, end="\r\n"),
        Expected(("Time", "Channel A", "Channel B"), ("ms", "V", "mV"), None, {1: ACC, 2: VOLT}),
    ),
    "Digilent": (
        "#Digilent WaveForms Oscilloscope Acquisition\n#Device Name: Discovery2\n#Serial Number: SN:210321A0\n"
        "#Date Time: 2026-11-22 10:11:12.123.456.789\n#Sample rate: 10240Hz\n#Samples: 40\n"
        "#Trigger: Source: Channel 1 Type: Edge Condition: Rising Level: 0 V Hyst.: Auto\n"
        "#Channel 1: Range: 5 V/div Offset: 0 V\n\nTime (s),Channel 1 (V),Channel 2 (V)\n"
        + table(times(1 / 10240), ACC, VOLT),
        Expected(("Time (s)", "Channel 1 (V)", "Channel 2 (V)"), ("", "", ""), 10240.0, {1: ACC, 2: VOLT}),
    ),
    "Catman": (
        "HBM_CATMAN_DATAFILE_40\nT0 = 22.11.2026 10:00:00\nSampleRate: 1200 Hz\n"
        "Zeit 1 - Standardrate\tCH=1\tCH=2\ns\tm/s²\tmV/V\n" + table(times(1 / 1200), ACC, VOLT, gap="\t", decimal=","),
        Expected(("Zeit 1 - Standardrate", "CH=1", "CH=2"), ("s", "m/s²", "mV/V"), 1200.0, {1: ACC, 2: VOLT}),
    ),
    "DASYLab": (
        "DASYLab - V 11.00.00\nWorksheet name: 6x\nRecording date     : 22.11.2026,  10:00:00\n"
        "Block length       : 1024\nDelta              : 9.765625e-005 sec.\nNumber of channels : 2\n"
        "Measurement time[s];Beschl [m/s²];Spannung [V]\n" + table(times(9.765625e-5), ACC, VOLT, gap=";", decimal=","),
        Expected(
            ("Measurement time[s]", "Beschl [m/s²]", "Spannung [V]"), ("", "", ""), 10240.0, {1: ACC, 2: VOLT}
        ),
    ),
    "DASYLab, a row of units": (
        "DASYLab - V 9.0\nBlock length;1024\nDelta;1.0E-3 sec\nUnit;g;V\nTime;acc;volt\n"
        + table(times(1e-3), ACC, VOLT, gap=";"),
        Expected(("Time", "acc", "volt"), ("", "g", "V"), 1000.0, {1: ACC, 2: VOLT}),
    ),
    "Dewesoft": (
        "Data file name: test.dxd\nSample rate: 10000 Hz\nStart time: 2026-11-22 10:00:00.5\n\n"
        "Data1 (X-axis)\tAI 1\tAI 2\n(s)\t(m/s2)\t(V)\n" + table(times(1e-4), ACC, VOLT, gap="\t"),
        Expected(
            ("Data1 (X-axis)", "AI 1", "AI 2"), ("s", "m/s2", "V"), 10000.0, {1: ACC, 2: VOLT},
            StartTime(NS_2026 + 500_000_000, epoch=True),
        ),
    ),
    "Polytec": (
        "Source File Name:\ttest.pvd\nSignal:\tVib - Velocity\nComponent:\tRoot Point\nPoint Index:\t1\n\n"
        "Time\tVelocity\n[ s ]\t[ m/s ]\n" + table(times(1e-5, form="{:.9e}"), ACC, gap="\t"),
        Expected(("Time", "Velocity"), ("s", "m/s"), None, {1: ACC}),
    ),
    "Graphtec": (
        'HEADER SIZE,22\nHEADER FORMAT,2\nVendor,"GRAPHTEC Corporation"\nModel,"GL900"\nSampling interval,"1ms"\n'
        'Total data points,"40"\nStart time,"2026/11/22","10:00:00"\nEnd time,"2026/11/22","10:00:01"\nAMP settings\n'
        "CH,Signal name,Input,Range,Filter,Span\n"
        'CH1,"acc","DC","10V","Off"," ","10.0000","-10.0000","V"\nCH2,"volt","DC","10V","Off"," ","10.0","-10.0","V"\n'
        "Logic/Pulse,Off\nData\nNumber,Date&Time,ms,CH1,CH2\nNO.,Time,ms,V,V\n"
        + table(
            range(1, COUNT + 1),
            ["2026/11/22 10:00:00"] * COUNT,
            [f"{n:03d}" for n in range(COUNT)],
            [f"{'-' if a < 0 else '+'}  {abs(a)}" for a in ACC],
            [f"{'-' if v < 0 else '+'}  {abs(v)}" for v in VOLT],
        ),
        Expected(
            ("Number", "Date&Time", "ms", "CH1", "CH2"), ("NO.", "Time", "ms", "V", "V"), 1000.0,
            {3: ACC, 4: VOLT}, at=3,
        ),
    ),
}  # fmt: skip

PEOPLE = {
    "equals sign": ("# sample_rate = 51200 Hz\nt,a,v\n", ",", 51200.0),
    "colon, no unit": ("# fs: 1000\nt,a,v\n", ",", 1000.0),
    "unit in the key": ("Sampling Rate [Hz]; 51200\nt;a;v\n", ";", 51200.0),
    "unit behind in": ("Abtastrate in kHz; 51.2\nt;a;v\n", ";", 51200.0),
    "unit at the key's end": ("# sample_rate_hz = 25600\nt,a,v\n", ",", 25600.0),
    "interval": ("# dt = 1e-4 s\nt,a,v\n", ",", 10000.0),
    "interval in ms": ("# sampling period: 0.5 ms\nt,a,v\n", ",", 2000.0),
    "an interval under the name of a rate": ("# sampling rate: 2 ms\nt,a,v\n", ",", 500.0),
    "samples per second": ("# Sample Rate: 51.2 kS/s\nt,a,v\n", ",", 51200.0),
    "two that agree": ("# fs = 10240 Hz, dt = 9.7656e-05 s\nt,a,v\n", ",", 10240.0),
    "rounded interval": ("# dt: 9.766e-5\nt,a,v\n", ",", 10240.0),
    "rounded rate": ("# fs: 13.33333 kHz\nt,a,v\n", ",", 1 / 75e-6),
    "decimal comma": ("Abtastrate: 51200,0 Hz\nt;a;v\n", ";", 51200.0),
    "blanks": ("# sampling rate 2048 Hz\n# t a v\n", " ", 2048.0),
    "Chinese": ("采样率：2000 Hz\nt,a,v\n".replace("：", ":"), ",", 2000.0),
    "Russian": ("# Частота дискретизации: 2000 Гц\nt,a,v\n", ",", 2000.0),
    "a rate of something": ("Baud rate: 9600\nRate: 5\nHeart rate: 60 Hz\nt,a,v\n", ",", None),
    "a dot behind a short word": ("Sampling freq. (kHz): 5\nt;a;v\n", ";", 5000.0),
    "a dash": ("# Sample rate - 5000 Hz\nt,a,v\n", ",", 5000.0),
    "is": ("# Sample rate is 5000 Hz\nt,a,v\n", ",", 5000.0),
    "an arrow": ("# sampling_rate -> 5000\nt,a,v\n", ",", 5000.0),
    "a symbol": ("# f_s = 5000 Hz\nt,a,v\n", ",", 5000.0),
    "JSON": ('# {"n": 40, "fs": 1000}\nt,a,v\n', ",", 1000.0),
    "without the word rate": ("# Sampling: 2 kHz\nt,a,v\n", ",", 2000.0),
    "words of anything": ("# Delta: 5\n# delta: 5 %\n# interval: 3 mm\n# increment = 1\nt,a,v\n", ",", None),
    "a device's capability": ("# Max sample rate: 100 MHz\nt,a,v\n", ",", None),
}


def opened(tmp_path, content: str | bytes, name="x.csv") -> CsvFile:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return CsvFile(path)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("maker", MAKERS)
def test_a_makers_layout_is_read_whole(tmp_path, maker, end):
    content, expected = MAKERS[maker]
    source = opened(tmp_path, content.replace("\r\n", "\n").replace("\n", end))

    assert source.names == expected.names
    assert tuple(source.stated_unit(p) for p in range(len(source.names))) == expected.units
    for position, values in expected.columns.items():
        np.testing.assert_array_equal(source.load([position])[0], values)
    clock = source.clock(expected.at)
    if expected.rate_hz is None:
        assert clock is None
    else:
        assert clock is not None
        assert clock.rate_hz == expected.rate_hz
        assert clock.start == expected.start


@pytest.mark.parametrize("head", PEOPLE)
def test_a_rate_in_the_words_of_people(tmp_path, head):
    lines, gap, rate_hz = PEOPLE[head]
    decimal = "," if gap == ";" and "kHz" not in lines else "."
    decimal = "." if "[Hz]" in lines else decimal
    source = opened(tmp_path, lines + table(times(1e-3), ACC, VOLT, gap=gap, decimal=decimal))

    assert source.names == ("t", "a", "v")
    clocks = [source.clock(position) for position in range(3)]
    assert [clock and clock.rate_hz for clock in clocks] == [rate_hz] * 3
    np.testing.assert_array_equal(source.load([1, 2]), [ACC, VOLT])


CONTRADICTIONS = {
    "two rates": ("# fs: 1000 Hz\n# sampling rate: 1024 Hz\nt,a,v\n", ("lines 1 and 2",)),
    "a rate and an interval": ("# fs: 1000 Hz\n#\n# dt: 0.5 ms\nt,a,v\n", ("line 3", "lines 1 and 3")),
    "an unknown unit": ("# sampling rate: 1000 foo\nt,a,v\n", ("line 1", "1000 foo")),
    "mHz or MHz": ("# sampling rate: 10 mhz\nt,a,v\n", ("line 1", "10 mhz")),
    "thousands": ("Sample rate;51,200 Hz\nt;a;v\n", ("line 1", "51,200")),
    "cut into two cells": ("Sample rate,51,200\nt,a,v\n", ("line 1", "51")),
    "zero": ("# dt = 0\nt,a,v\n", ("line 1",)),
}


@pytest.mark.parametrize("head", CONTRADICTIONS)
def test_a_rate_without_one_reading_is_refused(tmp_path, refused, head):
    lines, words = CONTRADICTIONS[head]
    content = lines + table(times(1e-3), ACC, VOLT, gap=";" if ";" in lines else ",")

    error = refused(lambda: opened(tmp_path, content), where="line 1" if "1 and" not in words[-1] else "lines")
    for word in words:
        assert word in str(error)


def test_segments_that_do_not_go_on_are_refused(tmp_path, refused):
    head, rows = LABVIEW.format(multi="Yes", x="No"), table(ACC, VOLT, gap="\t", begin="\t")
    later = 9.765625e-5 * COUNT
    line = f"line {(head + segment('0.0') + rows).count(chr(10)) + 1}"
    others = {
        "a gap": (segment(f"{later + 1e-5:.10E}"), "gap of 0.1"),
        "another second": (segment(f"{later:.10E}", time="10:00:01.125"), "gap of 10240"),
        "other units": (segment(f"{later:.10E}").replace("mV", "V"), "units"),
        "another channel": (segment(f"{later:.10E}").replace("volt", "temperature"), "channels"),
        "another rate": (segment(f"{later:.10E}").replace("9.765625E-5", "1.0E-4"), "rate"),
        "no start": (segment(f"{later:.10E}").replace("X0", "XX").replace("Date", "D"), "no start"),
    }
    for name, (second, found) in others.items():
        source = opened(tmp_path, head + segment("0.0") + rows + second + rows)
        error = refused(lambda source=source: source.load([1]), where=line, found=found, remedy="file of its own")
        assert "goes" not in error.problem, name


def test_lines_are_counted_through_segments_and_remarks(tmp_path, refused):
    head, rows = LABVIEW.format(multi="Yes", x="No"), table(ACC, VOLT, gap="\t", begin="\t")
    second = segment(f"{9.765625e-5 * COUNT:.10E}")
    content = head + segment("0.0") + rows + second + rows.replace("-0.25", "bad", 1)
    source = opened(tmp_path, content)
    line = content[: content.index("bad")].count("\n") + 1
    refused(lambda: source.load([2]), where=f"line {line}, column 3 ('volt')", found="'bad'")


def test_a_head_of_frequencies_states_no_rate(tmp_path):
    content = "Horizontal Units,Hz\nSample Interval,10\nf,a,b\n" + table(times(10), ACC, VOLT)
    source = opened(tmp_path, content)
    assert source.clock(1) is None
    assert source._channels[1].over_frequency
    lvm = LABVIEW.format(multi="No", x="No") + segment().replace("Time\tTime", "Frequency\tFrequency")
    source = opened(tmp_path, lvm + table(ACC, VOLT, gap="\t", begin="\t"), "x.lvm")
    assert source.clock(1) is None
    assert source._channels[2].over_frequency


UNITS = {
    "words": ("t,a,v\nsecond,Metre per second squared,Volts\n", ("second", "Metre per second squared", "Volts")),
    "square brackets": ("t;a;v\n[s];[g];[V]\n", ("s", "g", "V")),
    "round brackets": ("t,a,v\n(ms),(V),(mV)\n", ("ms", "V", "mV")),
    "above the names": ("s;g;mV\nt;a;v\n", ("s", "g", "mV")),
    "in a comment": ("# units: s, m/s^2, mV\nt,a,v\n", ("s", "m/s^2", "mV")),
    "in the last comment": ("# t,a,v\n# s,m/s²,mV\n", ("s", "m/s²", "mV")),
    "a sensitivity": ("t,a,v\ns,g,mV/(m/s²)\n", ("s", "g", "mV/(m/s²)")),
    "one for two ordinates": ("# unit: V\nt,a,v\n", ("", "", "")),
    "some columns": ("t,a,v\ns,-,V\n", ("s", "-", "V")),
    "a title above": ("Run,Monday,Room\nt,a,v\n", ("", "", "")),
    "symbols under a title": ("Sensor,Alice,Bob\nt,V,A\n", ("", "", "")),
}


@pytest.mark.parametrize("head", UNITS)
def test_a_row_of_units(tmp_path, head):
    lines, units = UNITS[head]
    source = opened(tmp_path, lines + table(times(1e-3), ACC, VOLT, gap=";" if ";" in lines else ","))
    assert tuple(source.stated_unit(p) for p in range(3)) == units
    assert source.names == (("t", "V", "A") if "symbols" in head else ("t", "a", "v"))


def test_names_and_units_between_blanks(tmp_path):
    source = opened(tmp_path, "t [s] a (g)  v [mV]\n" + table(times(1e-3), ACC, VOLT, gap="  "))
    assert source.names == ("t [s]", "a (g)", "v [mV]")


def test_a_line_of_the_head_is_not_the_first_row(tmp_path, refused):
    source = opened(tmp_path, "fs;1000\n" + table(ACC, VOLT, gap=";"))
    clock = source.clock(0)
    assert clock is not None
    assert clock.rate_hz == 1000.0
    np.testing.assert_array_equal(source.load([0])[0], ACC)
    content = "t,v\n" + table(times(1e-3), VOLT).replace("\n", ",a note\n", 1)
    refused(lambda: opened(tmp_path, content).load([1]), where="line 2", found="3 fields")
