"""The one palette: of figures, recordings and pages. Right is blue and left is vermilion."""

# Okabe and Ito's colours, which remain apart for colour-blind readers.
BLUE, VERMILION, GREEN = "#0072b2", "#d55e00", "#009e73"
ORANGE, PURPLE, SKY = "#e69f00", "#cc79a7", "#56b4e9"

RIGHT, LEFT, COM = BLUE, VERMILION, GREEN
SIDES = (("right", RIGHT), ("left", LEFT))
"""Name and colour of each side, in the order of every array with two feet."""
START, FINISH = "#40454d", PURPLE
"""Lines across the path where a walk begins and ends."""

INK, GREY, LINE, SHADE, WHITE = "#2b2f36", "#8a8f98", "#dfe2e6", "#eef0f3", "#ffffff"
"""Texts, marks of little weight, grids and shaded areas of figures, and their paper."""

SKY_ABOVE, SKY_BELOW = "#ccdeed", "#f7f7f5"
"""Background of a recording."""
FLOOR, FINE_LINE, COARSE_LINE = "#ccd1d6", "#babfc4", "#858c99"
"""Floor of a recording and its two grids."""
UNPAINTED = "#b3b3b3"
"""Parts of a robot whose file gives no colour."""
WARNING = "#fff3d6"
"""Background of a warning in a recording."""

FOCUS = "#0063a0"
"""Links and what has the focus: blue, darker, with a contrast of 4.5 to the page and more."""

ON_SCREEN = {
    "paper": "#fbfbfa",
    "card": WHITE,
    "ink": "#1b2027",
    "soft": "#535b66",
    "line": LINE,
    "accent": FOCUS,
    "good": "#00694d",
    "bad": "#a63c00",
    "marked": "#e7f2fa",
}
"""Colours of a page by what they are for. Good and bad are green and vermilion, darker."""

IN_THE_DARK = {
    "paper": "#14171b",
    "card": "#1d2126",
    "ink": "#e8eaed",
    "soft": "#a9b1bc",
    "line": "#363c44",
    "accent": "#74bdf0",
    "good": "#5fd0ab",
    "bad": "#ff9d63",
    "marked": "#1d3344",
}
"""The same for readers who have asked for dark pages."""

IN_PRINT = {
    "paper": WHITE,
    "card": WHITE,
    "ink": "#000000",
    "soft": "#444444",
    "line": "#bbbbbb",
    "accent": "#000000",
    "good": "#00543d",
    "bad": "#8a3200",
    "marked": "#eeeeee",
}
"""The same for a printer."""

STAGE = "#dde1e6"
"""Background of a portrait on a dark page, whose shadows need light."""


def rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of a colour "#rrggbb", each 0 to 1."""
    red, green, blue = (int(colour[start : start + 2], 16) / 255.0 for start in (1, 3, 5))
    return red, green, blue
