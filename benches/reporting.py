"""What the measuring programs of this folder share: running a program with its peak of memory, plots as SVG, sections of pages."""

import math
import os
import pathlib
import resource
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent


def run(command, env=None):
    """Runs a program; its output, and the most memory that it had [MiB]."""
    return run_timed(command, env)[:2]


def run_timed(command, env=None):
    """As `run`, and the time of all processors that it took [s], which other programs hardly change."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    env = {**os.environ, **(env or {})}
    words = [str(c) for c in command]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env)
    peak = 0
    while True:
        try:
            out, err = process.communicate(timeout=0.02)
            break
        except subprocess.TimeoutExpired:
            try:
                status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
                peak = max(peak, *(int(l.split()[1]) for l in status.splitlines() if l.startswith("VmHWM")), 0)
            except (OSError, TypeError):
                pass
    if process.returncode:
        raise RuntimeError((err.strip().splitlines() or [f"exit code {process.returncode}"])[-1])
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return out, peak / 1024.0, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def processor():
    """Its model."""
    try:
        model = [line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    except OSError:
        model = []
    return model[0] if model else "processor unknown"


def log_panels(panels, names, colors, columns=None):
    """An SVG of panels side by side, `{title: {kind: [(x, y), …]}}`, both axes logarithmic."""
    width, height, gap = 300, 260, 60
    columns = columns or len(panels)
    rows = -(-len(panels) // columns)
    size = (gap + (width + gap) * columns, gap + (height + gap) * rows)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]} {size[1]}" font-family="sans-serif" font-size="11">']
    parts.append(f'<rect width="{size[0]}" height="{size[1]}" fill="white"/>')
    for panel, (title, curves) in enumerate(panels.items()):
        points = [p for curve in curves.values() for p in curve]
        low, high = ([f(math.log10(p[a]) for p in points) + sign * 0.1 for a in range(2)] for f, sign in ((min, -1), (max, 1)))
        x0, y0 = gap + panel % columns * (width + gap), gap + panel // columns * (height + gap)
        at = lambda p: (
            x0 + width * (math.log10(p[0]) - low[0]) / (high[0] - low[0]),
            y0 + height * (high[1] - math.log10(p[1])) / (high[1] - low[1]),
        )
        parts.append(f'<text x="{x0}" y="{y0 - 12}" font-weight="bold">{title}</text>')
        parts.append(f'<rect x="{x0}" y="{y0}" width="{width}" height="{height}" fill="none" stroke="#888"/>')
        for axis in range(2):
            # Of many decades only whole powers are marked.
            digits = (1, 2, 5) if high[axis] - low[axis] < 2.5 else (1,)
            for tick in (d * 10.0**e for e in range(-6, 12) for d in digits):
                if low[axis] < math.log10(tick) < high[axis]:
                    x, y = at([(tick, 10.0 ** low[1]), (10.0 ** low[0], tick)][axis])
                    line = (x, y, x, y - height) if axis == 0 else (x, y, x + width, y)
                    parts.append('<line x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}" stroke="#ddd"/>'.format(*line))
                    place = (x, y + 14, "middle") if axis == 0 else (x - 4, y + 4, "end")
                    parts.append('<text x="{:.1f}" y="{:.1f}" text-anchor="{}">{:g}</text>'.format(*place, tick))
        for kind, curve in curves.items():
            dots = [at(p) for p in curve]
            line = " ".join(f"{x:.1f},{y:.1f}" for x, y in dots)
            parts.append(f'<polyline points="{line}" fill="none" stroke="{colors[kind]}" stroke-width="2"/>')
            parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colors[kind]}"/>' for x, y in dots]
            x, y = dots[0]
            parts.append(f'<text x="{x + 6:.1f}" y="{y - 4:.1f}" fill="{colors[kind]}">{names[kind]}</text>')
    return "\n".join([*parts, "</svg>", ""])


def write_section(page, begin, end, text):
    """Puts `text` between two marks of a page, or at its end with them."""
    before, _, rest = page.read_text().partition(begin)
    after = rest.partition(end)[2] or "\n"
    page.write_text(before.rstrip("\n") + "\n\n" + begin + "\n" + text + end + after)
