"""The validation sheet of the Kinect V2 as data: checks with their bands and sources.

The bands come from published measurements and from libfreenect2's decoder, not from the results of
this simulator: do not change a band because a sensor misses it. Numbers and bands follow section 10
of the design notes on the sensor; docs/validation.md names the sources.
"""

from __future__ import annotations

from math import inf

from glsim.validate.report import Band, Check

FANK = "Fankhauser 2015"
LF2 = "libfreenect2"
KDE = "Jaremo Lawin 2016"
OWN = "derived"

# fmt: off
CHECKS: tuple[Check, ...] = (
    Check("1", "white wall, 0.9 m: spatial sigma", (Band("0.9 m", 1.0, 1.7, "mm"),),
          f"{FANK}; Tolgyessy 2021"),
    Check("2", "the same: temporal sigma; its ratio to the spatial one",
          (Band("sigma_T", 0.4, 1.5, "mm"), Band("sigma_T/sigma_S", 0.0, 1.05)),
          f"{OWN}; Tolgyessy 2021"),
    Check("3", "spatial sigma over distance",
          (Band("1.5 m", 1.1, 1.8, "mm"), Band("2 m", 1.3, 2.1, "mm"),
           Band("3 m", 2.1, 3.4, "mm"), Band("4 m", 3.3, 5.5, "mm")), f"{FANK} +-25 %"),
    Check("4", "shape: sigma(4 m) / sigma(2 m), total; white part alone",
          (Band("all", 2.1, 3.0), Band("white", 2.8, 4.0)), f"{FANK}; {OWN}"),
    Check("5", "flat near the camera: sigma at 0.5, 0.9, 1.2 m, largest / smallest",
          (Band("max/min", 1.0, 1.5),), FANK),
    Check("6", "tilt at 0.9 m: sigma relative to a frontal wall",
          (Band("45 deg", 1.0, 1.3), Band("60 deg", 1.05, 1.6), Band("75 deg", 1.25, 3.8),
           Band("80 deg", 1.45, 6.0)), f"{FANK}; {OWN}"),
    Check("7", "albedo, white part: sigma(0.1) / sigma(1)",
          (Band("0.9 m", 3.2, 7.0), Band("2 m", 6.0, 10.0)), f"{KDE}; {OWN}"),
    Check("8", "amplitude: a(0.9 m) / a(1.8 m); deviation from albedo times cosine",
          (Band("ratio", 3.8, 4.2), Band("deviation", -3.0, 3.0, "%")), "physics"),
    Check("9", "phase noise before the filter at amplitudes 20, 50, 100 (80, 16, 120 MHz)",
          tuple(Band(f"{mhz} MHz @{a}", 0.8 * s, 1.2 * s, "rad")
                for mhz, row in ((80, (0.085, 0.033, 0.019)), (16, (0.055, 0.024, 0.017)),
                                 (120, (0.112, 0.040, 0.021)))
                for a, s in zip((20, 50, 100), row, strict=True)), f"{KDE} +-20 %"),
    Check("10", "fusion: depth noise / (110.5 mm sqrt(sum of phase variances)), a >= 15",
          (Band("least", 0.97, 1.03), Band("most", 0.97, 1.03)), f"{LF2}; {OWN}"),
    Check("11", "filter: sigma before / after, a >= 30",
          (Band("least", 2.8, 3.05), Band("most", 2.8, 3.05)), f"{LF2}; {OWN}"),
    Check("12", "spatial autocorrelation of the temporal noise at lags of pixels",
          (Band("(0,1)", 0.62, 0.72), Band("(0,2)", 0.27, 0.36), Band("(0,3)", -0.05, 0.05),
           Band("(1,1)", 0.42, 0.50), Band("(2,2)", 0.07, 0.13)), f"{LF2}; {OWN}"),
    Check("13", "white and Gaussian in time: lag 1; skewness, excess kurtosis at a > 100",
          (Band("lag 1", -0.05, 0.05), Band("skew", -0.1, 0.1), Band("kurtosis", -0.2, 0.2)),
          f"Belhedi 2015; {OWN}"),
    Check("14", "radial, wall at 1.5 m: sigma_T relative to the centre",
          (Band("r = 0.18", 1.0, 1.2), Band("corner", 1.8, 6.0)), f"Corti 2016; {OWN}"),
    Check("15", "lateral: jitter of a straight edge, 0.9 before 1.5 m",
          (Band("std", 0.25, 0.8, "px"),), f"{FANK}; {OWN}"),
    Check("16", "mixed pixels per edge row, 0.9 before 1.5 m: filters off (and none outside); on",
          (Band("off", 0.6, 2.1, "px"), Band("off, outside", 0.0, 0.005, "px"),
           Band("on", 0.0, 0.7, "px")), f"{LF2}; {OWN}"),
    Check("17", "sum of phasors, 0.9 before 2 m, filters off: pixels per row between; outside",
          (Band("between", 0.0, 0.1, "px"), Band("outside", 0.2, 1.1, "px")),
          f"physics; {LF2}; {OWN}"),
    Check("18", "edge filter: invalid pixels per row, 0.9 before 0.95 m; before 1.5 m",
          (Band("0.95 m", 0.0, 0.005, "px"), Band("1.5 m", 1.5, 2.1, "px")), f"{LF2}; {OWN}"),
    Check("19", "silhouette alone, filters off: depth beyond 30 mm of it; growth per side",
          (Band("strays", 0.0, 0.0, "px"), Band("growth", -0.5, 2.3, "px"),
           Band("mean growth", 0.0, 2.3, "px")), OWN),
    Check("20", "shadow of an edge at 0.9 m on 1.1, 1.5, 2 m; on the other three sides",
          (Band("1.1 m", 2.3, 4.3, "px"), Band("1.5 m", 6.3, 8.3, "px"),
           Band("2 m", 9.1, 11.1, "px"), Band("other sides", -1.0, 1.0, "px")),
          f"{LF2} (45 mm); geometry"),
    Check("21", "penumbra: levels of amplitude between light and dark; growth of sigma there",
          (Band("levels", 1.0, inf), Band("sigma", 1.2, 3.0)), OWN),
    Check("22", "quantisation: share of fractions; variance it adds; levels on a 10 cm ramp at 3 m",
          (Band("fractions", 0.0, 0.0), Band("variance", 0.07, 0.097, "mm^2"),
           Band("levels", 95.0, inf)), "MSDN"),
    Check("23", "amplitude at which half of the pixels are valid; share valid at 11 and above",
          (Band("a*", 3.0, 8.0), Band("valid", 99.0, 100.0, "%")), f"{LF2}; {OWN}"),
    Check("24", "isolated face, 0.9 m: invalid inside; clean mask kept; growth per rim pixel",
          (Band("invalid", 0.0, 0.2, "%"), Band("kept", 99.5, 100.0, "%"),
           Band("growth", 0.3, 2.3, "px")), OWN),
    Check("25", "range: share valid outside 500 to 4500 mm; least share valid inside",
          (Band("outside", 0.0, 0.0, "%"), Band("inside", 99.0, 100.0, "%")), f"{LF2}; MSDN"),
    Check("26", "wiggle, 0.6 to 3 m: peak; power off the periods of three taps; at 468 mm",
          (Band("peak", 1.5, 8.0, "mm"), Band("other", 0.0, 10.0, "%"),
           Band("468 mm", 0.0, 5.0, "%")), f"Corti 2016; {LF2}; {OWN}"),
    Check("27", "fixed pattern; same map in all frames; sqrt(FPN^2 + sigma_T^2) / sigma_S",
          (Band("FPN", 0.3, 1.2, "mm"), Band("same map", 0.95, 1.0),
           Band("sum", 0.95, 1.05)), OWN),
    Check("28", "unwrapping: errors beyond 300 mm on walls at a >= 15, 0.5 to 4.5 m",
          (Band("gross", 0.0, 1e-4),), f"{LF2}; {OWN}"),
    Check("29", "device offset; change from frame to frame; skin bias if enabled",
          (Band("offset", -30.0, 30.0, "mm"), Band("change", 0.0, 0.1, "mm"),
           Band("skin", 4.0, 12.0, "mm")), f"iai_kinect2; {OWN}"),
    Check("30", "normals of a noisy face: mean angle to the clean ones",
          (Band("angle", 12.0, 24.0, "deg"),), OWN),
)
# fmt: on

_ANTI = "what a structured-light model shows"

ANTI_CHECKS: tuple[Check, ...] = (
    Check("A1", "no disparity banding: levels of depth missing on a ramp at 3 m",
          (Band("missing", 0.0, 5.0, "%"),), _ANTI),
    Check("A2", "no z^2 law below 1.5 m: exponent of sigma over 0.6 to 1.5 m",
          (Band("exponent", -inf, 1.0),), _ANTI),
    Check("A3", "no sharp shadow of 20 to 50 px on a face at 0.9 m: longest hole in a row",
          (Band("hole", 0.0, 19.0, "px"),), _ANTI),
    Check("A4", "frontal skin at 0.9 m: sigma", (Band("sigma", 0.0, 3.0, "mm"),), _ANTI),
    Check("A5", "noise not white: correlation of neighbours", (Band("lag 1", 0.3, 1.0),), _ANTI),
    Check("A6", "noise not smooth over 32 px: correlation 8 px away",
          (Band("lag 8", -0.1, 0.1),), _ANTI),
)  # fmt: skip
