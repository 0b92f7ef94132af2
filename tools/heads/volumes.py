"""Table of the template head's volumes: bones, muscles, fat pads, cartilage.

Millimetres, canonical frame, subject's left half (the right half is its mirror image). Positions
follow mean adult landmarks (both sexes): L. G. Farkas, "Anthropometry of the Head and Face",
2nd ed. 1994 (n-gn 118, n-sn 52, zy-zy 135, eu-eu 148, g-op 193, al-al 34, en-en 33, ex-ex 91,
ch-ch 52); the globe is 24 mm across, its apex 16 mm in front of the lateral orbital rim
(Migliori & Gladstone 1984).
"""

from __future__ import annotations

from tools.heads.signed_distance import Capsule, Ellipsoid, Volume

NASION_Y, SUBNASALE_Y, MENTON_Y = 24.0, -29.5, -95.0  # heights in the median plane
EYE_CENTER = (32.0, 15.0, -6.0)  # of the left eyeball

SKULL: tuple[Volume, ...] = (
    Ellipsoid("cranium", (0, 53, -80), (74, 79, 93), 1.0),
    Ellipsoid("forehead", (0, 52, -42), (56, 46, 60), 16.0),
    Ellipsoid("occiput", (0, 36, -118), (60, 58, 56), 20.0),
)

FACE: tuple[Volume, ...] = (
    Ellipsoid("midface", (0, -14, -42), (52, 52, 57), 14.0),
    Capsule("brow ridge", (10, 33, 4), (40, 34, -10), 13.0, 11.0, 12.0),
    Capsule("lateral orbital rim", (46, 30, -22), (49, 4, -22), 9.0, 9.0, 12.0),
    Ellipsoid("zygoma", (43, -9, -17), (18, 15, 17), 14.0, yaw_deg=35),
    Capsule("zygomatic arch", (50.5, -7, -32), (57.5, -3, -75), 8.5, 7.5, 22.0),
    Ellipsoid("jaw mass", (0, -54, -44), (38, 38, 54), 14.0),
    Capsule("mandible body", (36.5, -64, -58), (12, -83, -6), 8.5, 8.5, 12.0),
    Capsule("mandible ramus", (36, -61, -62), (54, -5, -74), 8.5, 10.0, 18.0),
    Ellipsoid("buccal fat", (30, -34, -22), (22, 27, 27), 16.0, yaw_deg=35),
    Ellipsoid("temporalis", (50, 24, -48), (14, 34, 30), 16.0, yaw_deg=15),
    Ellipsoid("masseter", (46, -27, -48), (11, 34, 28), 20.0),
    Ellipsoid("jowl", (30, -56, -30), (15, 20, 26), 18.0, yaw_deg=20),
    Ellipsoid("under the chin", (0, -76, -46), (34, 22, 44), 14.0, pitch_deg=-8),
    Ellipsoid("dental arch", (0, -44, -14), (30, 28, 33), 14.0),
    Ellipsoid("chin", (0, -81, 3), (15.5, 12.5, 14), 14.0),
)

NECK: tuple[Volume, ...] = (
    Capsule("neck", (0, -60, -98), (0, -165, -104), 46.0, 51.0, 18.0),
    Capsule("nape", (0, 20, -128), (0, -125, -126), 36.0, 36.0, 24.0),
    Capsule("throat", (0, -104, -64), (0, -160, -72), 20.0, 17.0, 20.0),
    Capsule("sternocleidomastoid", (52, -34, -96), (13, -164, -60), 10.0, 9.0, 9.0),
    Capsule("its clavicular head", (47, -85, -90), (42, -168, -70), 9.0, 8.0, 12.0),
    Capsule("upper trapezius", (16, -40, -138), (56, -152, -130), 18.0, 24.0, 26.0),
    Capsule("spine", (0, -128, -134), (0, -300, -158), 32.0, 66.0, 40.0),
    Capsule("trapezius", (54, -156, -128), (166, -210, -116), 25.0, 20.0, 34.0),
)

# The bust. ANSUR II (C. C. Gordon et al., NATICK/TR-15/007, 2014), mean of men and women:
# biacromial breadth 390, bideltoid 480, chest depth 250 mm; the jugular notch lies about 80 mm
# below the chin. Large volumes fill the inside, so that rays from the axis reach the skin.
BUST: tuple[Volume, ...] = (
    Capsule("shoulder girdle", (0, -246, -116), (172, -250, -114), 62.0, 44.0, 30.0),
    Capsule("flank", (40, -275, -118), (34, -430, -112), 97.0, 92.0, 40.0),
    Ellipsoid("upper back", (0, -285, -140), (118, 116, 80), 50.0),
    Ellipsoid("scapula", (88, -268, -168), (56, 70, 40), 50.0, yaw_deg=-20),
    Ellipsoid("deltoid", (186, -246, -113), (48, 56, 48), 26.0),
    Capsule("upper arm", (184, -266, -112), (178, -540, -104), 48.0, 46.0, 40.0),
    Ellipsoid("pectoral", (72, -292, -66), (74, 50, 46), 36.0, yaw_deg=22),
    Ellipsoid("sternum", (0, -300, -62), (40, 110, 44), 40.0, pitch_deg=-10),
    Capsule("clavicle, medial half", (15, -177, -58), (88, -181, -66), 9.0, 8.5, 22.0),
    Capsule("clavicle, lateral half", (88, -181, -66), (170, -197, -103), 8.5, 9.0, 22.0),
    Ellipsoid("jugular notch", (0, -165, -42), (9, 12, 12), 12.0, carve=True),
    Ellipsoid("supraclavicular fossa", (80, -160, -62), (34, 13, 18), 16.0, yaw_deg=22, carve=True),
)

ORBIT: tuple[Volume, ...] = (
    Ellipsoid("eye socket", (33, 12, 17), (19, 11, 15), 10.0, yaw_deg=22, carve=True),
    Ellipsoid("lower lid and malar fat", (33, -1, -10), (18, 11, 13.0), 12.0, yaw_deg=22),
    Ellipsoid("upper lid fat", (36, 26, -6.5), (16, 8, 11.5), 8.0, yaw_deg=22),
    Ellipsoid("lids", EYE_CENTER, (14.1, 14.1, 14.1), 6.0),
)

NOSE: tuple[Volume, ...] = (
    Capsule("nasal pyramid", (4, 20, -4), (8.5, -16, 12.5), 8.5, 8.5, 13.0),
    Capsule("dorsum", (0, 26, 8.2), (0, -15, 31.0), 6.2, 6.4, 14.0),
    Ellipsoid("tip", (0, -18.5, 32.5), (8.6, 8.2, 9.2), 8.0),
    Ellipsoid("lobule side", (6, -20, 27), (6, 6.5, 8), 6.0, yaw_deg=20),
    Ellipsoid("ala", (12.3, -22.3, 19.5), (5.0, 6.6, 8.0), 3.0, yaw_deg=-22, pitch_deg=8),
    Capsule("columella", (0, -25, 35), (0, -28, 19), 3.2, 3.8, 3.0),
    Ellipsoid(
        "nostril", (6.8, -28.5, 25), (3.0, 5.5, 6.3), 2.0, pitch_deg=20, yaw_deg=-22, carve=True
    ),
)

HEAD: tuple[Volume, ...] = SKULL + FACE + NECK + ORBIT + NOSE
TRUNK: tuple[Volume, ...] = NECK + BUST
