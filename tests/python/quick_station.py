"""The demo's station with fast axes and a short plan: a run takes a few seconds. Its twin is told the same."""

import shutil

from etalon.testing import demo

SHORT = {
    "poses: 100": "poses: 26",
    "repeats: 8": "repeats: 0",
    "frames: 5": "frames: 1",
    "settle_ms: 50": "settle_ms: 5",
    "speed: 400": "speed: 4000",
    "speed_deg: 360": "speed_deg: 3600",
}


def write_quick_station(folder, twin_changes=()):
    """Copies of the demo's files; returns (twin.yaml, station.yaml). twin_changes: (what, by) pairs."""
    for file in demo.iterdir():
        shutil.copy(file, folder)
    for name, changes in (("station.yaml", ()), ("twin.yaml", twin_changes)):
        text = (folder / name).read_text()
        for what, by in (*SHORT.items(), *changes):
            text = text.replace(what, by)
        (folder / name).write_text(text)
    return folder / "twin.yaml", folder / "station.yaml"
