"""Draws the rows of tools/measured/peers.json: how many times as long each program takes, SVG."""

import html
import json
import math
import sys

source, output = sys.argv[1:]
rows = json.load(open(source))["rows"]
LEFT, WIDTH, LINE, TOP = 470, 900, 22, 46
most = max([2.0] + [row["high"] for row in rows])
least = min([0.5] + [row["low"] for row in rows])
span = math.log10(most / least)


def x(ratio):
    return LEFT + (WIDTH - LEFT - 60) * math.log10(ratio / least) / span


height = TOP + LINE * len(rows) + 24
parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
         'font-family="sans-serif" font-size="12">',
         f'<rect width="{WIDTH}" height="{height}" fill="white"/>',
         f'<text x="{LEFT}" y="16">time, in times of pointillist; bars are 95 % intervals</text>']
for exponent in range(math.floor(math.log10(least)), math.ceil(math.log10(most)) + 1):
    for mark in (1, 2, 5):
        ratio = mark * 10.0**exponent
        if least <= ratio <= most:
            shade = "#333" if ratio == 1 else "#ddd"
            parts.append(f'<path d="M{x(ratio):.1f} {TOP - 12}V{height - 20}" stroke="{shade}"/>'
                         f'<text x="{x(ratio):.1f}" y="{TOP - 16}" text-anchor="middle" '
                         f'fill="#555">{ratio:g}</text>')
for at, row in enumerate(rows):
    y = TOP + LINE * at + LINE / 2
    color = "#b2182b" if row["ratio"] < 1 else "#2166ac"
    name = f"{row['job']}, {row['points'] / 1e6:g} M: {row['peer']}"
    if row.get("note"):
        name += f" ({row['note']})"
    parts.append(
        f'<text x="{LEFT - 10}" y="{y + 4:.1f}" text-anchor="end">{html.escape(name)}</text>'
        f'<path d="M{x(row["low"]):.1f} {y}H{x(row["high"]):.1f}" stroke="{color}" '
        f'stroke-width="3"/><circle cx="{x(row["ratio"]):.1f}" cy="{y}" r="5" fill="{color}"/>'
        f'<text x="{x(row["high"]) + 8:.1f}" y="{y + 4:.1f}" fill="{color}">'
        f'{row["ratio"]:.3g}</text>')
open(output, "w").write("\n".join([*parts, "</svg>"]) + "\n")
