"""Sources of the bands of the checks, as the tables print them.

The bands come from published measurements, from real frames and from libfreenect2's decoder, not
from the results of this simulator: do not change a band because a sensor misses it.
docs/validation.md names the sources. Where real frames and a paper differ, a band holds both, or
the real frames alone if they contradict the paper.
"""

from __future__ import annotations

FANK = "Fankhauser 2015"
LF2 = "libfreenect2"
KDE = "Jaremo Lawin 2016"
#: Frames of a Kinect V2 with infrared (alberttjc/iai_kinect2, folder kinect_cal_data) and of three
#: other devices.
REAL = "real frames"
OWN = "derived"
STRUCTURED_LIGHT = "what a structured-light model shows"
NGUYEN = "Nguyen 2012"
#: The simulators whose constants ``kinect-v1`` shares and ``kinect-v2-paper`` re-implements.
#: pyk4a's test recording of an Azure Kinect: one frame with infrared (docs/time_of_flight.md).
AZURE = "real frame"
#: The hardware specification of the Azure Kinect.
MICROSOFT = "Microsoft"
#: Frames of D435, D455 and D405 cameras from public repositories (docs/explanation/stereo.md).
D4XX = "real frames of D4xx"
#: Frames of two iPhones and two iPads, unfiltered (ZEISS/iPad_TrueDepth_Issue_Eval and others).
TRUEDEPTH = "real frames of TrueDepth"
#: Clouds of the Object Segmentation Database (PointCloudLibrary/data).
KINECT_V1_FRAMES = "real frames of a Kinect V1"
ANCESTORS = "render_kinect, BlenSor"
