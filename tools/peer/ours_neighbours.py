"""Times what `index --luminance`, means over 40 neighbours, takes longer than `index`: the search
through the leaves, and more."""

import json
import subprocess
import sys
import time
from pathlib import Path

scan, program, folder = sys.argv[1:]
seconds = []
for options in ([], ["--luminance"]):
    out = Path(folder) / "neighbours.pnti"
    out.unlink(missing_ok=True)
    start = time.perf_counter()
    subprocess.run([program, "index", scan, "-o", out, *options], check=True,
                   stderr=subprocess.DEVNULL)
    seconds.append(time.perf_counter() - start)
print(json.dumps(dict(seconds_of_frames=[seconds[1] - seconds[0]])))
