# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Draw boxes and arrows as SVG, in light and dark, with text that can be searched."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

LINE = 17
"""[px] Height of a line of text."""
_STYLE = """
svg { color-scheme: light dark; }
text { font: 13px system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; fill: #1a1c23; }
.title { font-weight: 600; }
.note, .label { fill: #5c616b; font-size: 11.5px; }
.code { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: 12px; }
.page { fill: #fdfdfb; }
.box { fill: #eaf2f9; stroke: #0072b2; stroke-width: 1.4; }
.data { fill: #f4f2ee; stroke: #8a8d91; }
.aside { fill: none; stroke: #8a8d91; stroke-dasharray: 4 3; }
.arrow { fill: none; stroke: #5c616b; stroke-width: 1.3; }
.head { fill: #5c616b; }
@media (prefers-color-scheme: dark) {
  text { fill: #e6e6e3; } .note, .label { fill: #a9adb5; } .page { fill: #1c1e24; }
  .box { fill: #17303f; stroke: #56b4e9; } .data { fill: #2a2c33; stroke: #8a8d91; }
  .arrow { stroke: #a9adb5; } .head { fill: #a9adb5; }
}
"""


@dataclass
class Drawing:
    """Parts of a picture of a given size [px], and what it shows in a sentence."""

    width: float
    height: float
    sentence: str
    parts: list[str] = field(default_factory=list)

    def box(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        title: str = "",
        lines: Sequence[str] = (),
        *,
        style: str = "box",
        line_style: str = "note",
    ) -> None:
        """Add a box with a bold title and lines below it, centred."""
        self.parts.append(
            f'<rect class="{style}" x="{x:g}" y="{y:g}"'
            f' width="{width:g}" height="{height:g}" rx="7"/>'
        )
        texts = [(title, "title")] * bool(title) + [(line, line_style) for line in lines]
        top = y + height / 2 - LINE * (len(texts) - 1) / 2 + 4.5
        for index, (text, look) in enumerate(texts):
            self.text(x + width / 2, top + index * LINE, text, look)

    def text(self, x: float, y: float, text: str, style: str, anchor: str = "middle") -> None:
        """Add a line of text."""
        self.parts.append(
            f'<text class="{style}" x="{x:g}" y="{y:g}" text-anchor="{anchor}">'
            f"{escape(text)}</text>"
        )

    def arrow(self, *points: tuple[float, float], head: bool = True) -> None:
        """Add straight lines through the points with a head at the end."""
        path = "M" + " L".join(f"{x:g},{y:g}" for x, y in points)
        self.path(path, head=head)

    def path(self, path: str, *, head: bool = True) -> None:
        """Add a line in SVG's own words with a head at the end."""
        end = ' marker-end="url(#head)"' if head else ""
        self.parts.append(f'<path class="arrow" d="{path}"{end}/>')

    def __str__(self) -> str:
        """Return the file."""
        return f"""<!--
SPDX-FileCopyrightText: 2026 The terrain_estimator authors
SPDX-License-Identifier: Apache-2.0
-->
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width:g} {self.height:g}" role="img">
<title>{escape(self.sentence)}</title>
<style>{_STYLE}</style>
<defs>
<marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7"
 orient="auto">
<path class="head" d="M0,0 L8,4 L0,8 z"/></marker></defs>
<rect class="page" width="{self.width:g}" height="{self.height:g}" rx="10"/>
{chr(10).join(self.parts)}
</svg>
"""
