"""A drawing of a report as a file of its own, which browsers and pages of documents show."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tactile_ros.evaluation.stylesheet import STYLE

if TYPE_CHECKING:
    from tactile_ros.evaluation.svg import Plot

# variables of both schemes, and what concerns drawings
RULES = re.compile(
    r'^(?::root \{.*?^\}|@media[^\n]*dark\) \{.*?^\}|svg .*?\}|\.[cs]\d .*?\}$)',
    re.DOTALL | re.MULTILINE,
)


def standalone(plot: Plot) -> str:
    """The drawing (SVG text) with the look of reports, light or dark as its reader prefers."""
    style = '\n'.join(RULES.findall(STYLE)).replace('svg.plot', '.plot')
    ground = '<rect width="100%" height="100%" fill="var(--card)"/>'
    width, height = plot.size
    sized = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
    head, body = str(plot).split('>', 1)
    return f'{sized}{head[5:]}><style>{style}</style>{ground}{body}\n'
