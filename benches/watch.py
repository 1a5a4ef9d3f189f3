#!/usr/bin/env python3
"""Time from saving a scene to the first pixels of `curlsmoke watch`, as a page sees them: docs/watch.md, section "How soon".

Needs target/release/curlsmoke (or the program named by CURLSMOKE). Each change is saved ROUNDS times, in turns, but for that of the
flow, which is saved once; medians are printed as a table.
"""

import json
import os
import statistics
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = os.environ.get("CURLSMOKE", str(ROOT / "target/release/curlsmoke"))
ROUNDS = int(os.environ.get("ROUNDS", "5"))
# What is changed, where it stands in the scene, and two values that take turns.
CHANGES = [
    ("light", "irradiance: [7.0, 5.8, 4.4]", "irradiance: [6.0, 5.8, 4.4]"),
    ("material", "reflectance: [0.50, 0.42, 0.35]", "reflectance: [0.40, 0.42, 0.35]"),
    ("camera", "position: [0.85, 1.15, 3.6]", "position: [0.95, 1.15, 3.6]"),
    ("smoke medium", "extinction: 60", "extinction: 50"),
    ("flow", "speed: 0.3", "speed: 0.31"),
]


def status(url, after=0):
    with urllib.request.urlopen(f"{url}status?after={after}", timeout=60) as answer:
        return json.load(answer)


def wait(url, condition):
    """The first status that fulfils the condition."""
    now = status(url)
    while not condition(now):
        now = status(url, now["version"])
    return now


def main():
    with tempfile.TemporaryDirectory() as folder:
        text = (ROOT / "scenes/plume.yaml").read_text().replace("meshes/", f"{ROOT}/scenes/meshes/")
        scene = Path(folder) / "scene.yaml"

        def save(changed):
            new = Path(folder) / "new"
            new.write_text(changed)
            new.rename(scene)

        save(text)
        command = [PROGRAM, "watch", str(scene), "--serve", "0", "--resolution", "640x360", "--spp", "1", "--frame", "12"]
        start = time.monotonic()
        program = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        try:
            url = program.stdout.readline().strip()
            done = wait(url, lambda now: now["picture"] > 0)
            print(f"from the start to the first pixels: {time.monotonic() - start:.2f} s")
            times = {name: [] for name, _, _ in CHANGES}
            made = {}
            for round_idx in range(ROUNDS):
                for name, old, new in CHANGES if round_idx == 0 else CHANGES[:-1]:
                    assert old in text, old
                    done = wait(url, lambda now: now["activity"] == "done")
                    start = time.monotonic()
                    save(text.replace(old, new))
                    seen = wait(url, lambda now: now["picture"] > done["picture"])
                    times[name].append(time.monotonic() - start)
                    made[name] = ", ".join(seen["made"]) or "nothing"
                    done = wait(url, lambda now: now["activity"] == "done")
                    save(text)
                    wait(url, lambda now: now["picture"] > done["picture"])
            print("\n| change of | made again | first pixels after [s] |\n|---|---|---|")
            for name, _, _ in CHANGES:
                low, high = min(times[name]), max(times[name])
                print(f"| {name} | {made[name]} | {statistics.median(times[name]):.2f} ({low:.2f} to {high:.2f}) |")
        finally:
            program.terminate()
            program.wait()


if __name__ == "__main__":
    main()
