# Draws a film or a poster on as many machines as Snakemake is given.
#
#   snakemake -s tools/cluster/pictures.smk --cores 2 --config cloud=site.pnti path=tour.json out=tour.mp4
#   snakemake -s tools/cluster/pictures.smk --cores 2 --config cloud=site.pnti size=40000x20000 out=poster.png
#
# Machines share the folder of the cloud and of the pictures. Other settings, as NAME=VALUE behind
# --config: parts (16), options of `render` (options='--color intensity'), program.

from glob import glob
from pathlib import Path

CLOUD = config.get("cloud", "site.pnti")
PATH = config.get("path")
OUT = config.get("out", "tour.mp4" if PATH else "poster.png")
SIZE = config.get("size", "1920x1080")
PARTS = int(config.get("parts", 16))
PROGRAM = config.get("program", "pointillist")
OPTIONS = config.get("options", "")
WORK = str(Path(OUT).with_suffix("")) + ".parts"
FILES = CLOUD if isinstance(CLOUD, list) else sorted(glob(CLOUD))

if not FILES:
    raise WorkflowError(f"no file is {CLOUD}; --config cloud=site.pnti names one")


def done(number):
    """A part of a path is done when its last frame is there: a file without contents tells."""
    return f"{WORK}/{number}.done" if PATH else f"{WORK}/{number}.png"


rule all:
    input:
        OUT,


if PATH:

    rule frames:
        input:
            FILES,
            PATH,
        output:
            touch(f"{WORK}/{{number}}.done"),
        threads: 2
        params:
            frames=f"{WORK}/frame.png",
            path=PATH,
        shell:
            "{PROGRAM} render {FILES:q} -o {params.frames:q} --path {params.path:q} --size {SIZE}"
            " --part {wildcards.number}/{PARTS} --resume {OPTIONS}"

    rule film:
        input:
            [done(number) for number in range(1, PARTS + 1)],
        output:
            OUT,
        params:
            frames=f"{WORK}/frame-*.png",
            rate=config.get("fps", 25),
        shell:
            "ffmpeg -loglevel error -y -framerate {params.rate} -pattern_type glob"
            " -i {params.frames:q} -pix_fmt yuv420p {output:q}"

else:

    rule rows:
        input:
            FILES,
        output:
            temp(f"{WORK}/{{number}}.png"),
        threads: 2
        shell:
            "{PROGRAM} render {FILES:q} -o {output:q} --size {SIZE}"
            " --part {wildcards.number}/{PARTS} {OPTIONS}"

    rule poster:
        input:
            [done(number) for number in range(1, PARTS + 1)],
        output:
            OUT,
        shell:
            "for part in {input:q}; do pngtopnm \"$part\" > \"$part.ppm\"; done;"
            " pnmcat -topbottom $(printf '%s.ppm ' {input:q}) | pnmtopng > {output:q};"
            " rm $(printf '%s.ppm ' {input:q})"
