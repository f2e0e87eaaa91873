"""Imitate Gradescope: run an autograder as root in its folders, and check its results."""

import json
import os
import pathlib
import shutil
import subprocess
import zipfile

import pytest

from support.paths import CHECKOUT

_OF_DOCKER = "chown dac_override fowner fsetid kill setgid setuid setpcap net_bind_service net_raw"
CAPABILITIES = ",".join(
    f"+{each}" for each in f"{_OF_DOCKER} sys_chroot mknod audit_write setfcap".split()
)
"""The capabilities of root in a container."""

REFUSED = 77
SCRIPT = """
set -eu
source=$1 submissions=$2 out=$3 lower=$4 root=$5/root capabilities=$6
if [ "$submissions" ]; then
  overlay="lowerdir=$lower,upperdir=$5/upper,workdir=$5/work"
  mount -t tmpfs tmpfs "$5" && mkdir "$5/upper" "$5/work" "$root" &&
    mount -t overlay -o "$overlay" overlay "$root" || exit 77
else
  mkdir "$root" && mount --bind "$lower" "$root"
fi
mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
mount -t tmpfs tmpfs "$root/tmp"
inside() {
  setpriv --bounding-set "$1" --inh-caps=-all chroot "$root" \
    env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C sh -c "cd /autograder && exec $2"
}
rm -rf "$root/opt/mushr_ros_intro" "$root/autograder"
mkdir "$root/autograder"
cd "$root/autograder"
cp -a "$source" source
inside "-all,$capabilities" /autograder/source/setup.sh
[ "$submissions" ] || { rm "$root"/var/cache/apt/archives/*.deb; exit 0; }
for submission in "$submissions"/*; do
  rm -rf results submission
  cp -a "$source/." source
  cp -a source/run_autograder .
  cp -a "$submission" submission
  echo '{"users": [{"id": 42, "email": "ann@x.edu"}]}' >submission_metadata.json
  mkdir results
  case $submission in
  */slow) sed -i 's/^limit=.*/limit=1/' run_autograder ;;
  */unset) sed -i s/sandbox/nowhere/ source/arguments ;;
  esac
  case $submission in */right) allowed=+all ;; *) allowed="-all,$capabilities" ;; esac
  inside "$allowed" ./run_autograder >&2
  cp results/results.json "$out/${submission##*/}.json"
done
"""
FORMATS = ("text", "html", "simple_format", "md", "ansi")
VISIBILITIES = ("hidden", "after_due_date", "after_published", "visible")
STATES = ("passed", "failed")
REPORT = {
    **{"score": (int, float), "output": str, "tests": list},
    **dict.fromkeys(("output_format", "test_output_format", "test_name_format"), FORMATS),
    "stdout_visibility": VISIBILITIES,
}
TEST = {
    **{"score": (int, float), "max_score": (int, float), "status": STATES},
    **{"name": str, "output": str, "visibility": VISIBILITIES},
}
"""Fields that are documented for results.json, with their types or values."""


def check_fields(value, fields):
    """Check that the fields of an object are documented, and have documented values."""
    for name, one in value.items():
        expected = fields[name]
        if expected in (FORMATS, VISIBILITIES, STATES):
            assert one in expected, name
        else:
            assert isinstance(one, expected) and not isinstance(one, bool), name


def unpack(path, folder):
    """Unpack a zip with the permissions of its files."""
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
        for each in archive.infolist():
            (folder / each.filename).chmod(each.external_attr >> 16)


def _run_script(*arguments):
    """Run SCRIPT in a namespace of its own; return its output. Skip the test if this is refused."""
    # setpriv of Debian 11 needs the /proc of the namespace.
    space = ["unshare", "--mount-proc", "--pid", "--fork", "--kill-child"]
    command = ["bash", "-c", SCRIPT, "-", *map(str, arguments), CAPABILITIES]
    done = subprocess.run([*space, *command], capture_output=True)
    log = (done.stdout + done.stderr).decode(errors="replace")
    if done.returncode == REFUSED or log.startswith("unshare:"):
        pytest.skip(f"this system refuses namespaces or overlays: {log}")
    assert done.returncode == 0, log
    return log


def _installed(source, bare, machine):
    """Return a bare root file system in which setup.sh has run once.

    It is kept for later runs, until the scripts that install packages change.
    """
    kept = pathlib.Path(CHECKOUT, "build", ".bare")
    root, inputs = kept / "root", kept / "inputs"
    scripts = [f"{CHECKOUT}/scripts/{name}" for name in ("setup", "dev/autograder/setup.sh")]
    current = bare + "".join(pathlib.Path(script).read_text() for script in scripts)
    if not inputs.exists() or inputs.read_text() != current:
        shutil.rmtree(kept, ignore_errors=True)
        kept.mkdir(parents=True)
        release, *mirror = bare.split()
        components = f"--components=main{',universe' if mirror else ''}"
        bootstrap = ["debootstrap", "--variant=minbase", components, release, root, *mirror]
        subprocess.run(bootstrap, check=True, stdout=subprocess.DEVNULL)
        _run_script(source, "", "", root, machine)
        inputs.write_text(current)
    return root


def run(source, given, folder, bare=None):
    """Run setup.sh once and run_autograder for each submission; return the results by its name.

    A submission "slow" gets a limit of 1 s, "unset" an autograder that cannot work, and "right" all
    capabilities; the others have those of a container. Skip the test if the system does not allow
    this.

    Args:
        source: the folder with the unpacked autograder.
        given: the folder with the submissions.
        folder: an empty folder.
        bare: the release and optionally the mirror of a bare root file system that debootstrap
            creates, such as "bookworm"; by default, this machine's. Both stay as they are.
    """
    if os.geteuid() != 0:
        pytest.skip("only root can run an autograder in a root file system of its own")
    out, machine = folder / "out", folder / "machine"
    out.mkdir()
    machine.mkdir()
    lower = _installed(source, bare, machine) if bare else "/"
    log = _run_script(source, given, out, lower, machine)
    return {each.stem: json.loads(each.read_text()) for each in out.iterdir()}, log
