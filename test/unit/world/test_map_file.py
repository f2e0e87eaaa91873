"""Map files: the cells of every kind of image as map_server has them, and one line per fault."""

import math
import os
import struct
import subprocess
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.world.grid import as_travelled
from mushr_ros_intro.world.map_file import MODES, MapError, find_map, read_map
from support.paths import FIXTURES, PACKAGE

MAPS = os.path.join(PACKAGE, "maps")

GOOD = {
    "image": "map.png",
    "resolution": "0.05",
    "origin": "[-1.0, 2.0, 0.3]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}


def write_yaml(folder, **changes):
    """Write a map's YAML file, which is good except for the changes; None omits a key."""
    keys = {**GOOD, **changes}
    path = folder / "map.yaml"
    path.write_text(
        "".join(f"{key}: {value}\n" for key, value in keys.items() if value is not None)
    )
    return str(path)


def write_png(folder, pixels, mode=None, **options):
    """Write an image; row 0 of the pixels is at the top."""
    Image.fromarray(np.asarray(pixels, np.uint8), mode).save(str(folder / "map.png"), **options)


def faults_of(path):
    with pytest.raises(MapError) as caught:
        read_map(path)
    return str(caught.value)


def expected_cell(channels, has_alpha, negate, occupied, free, mode):
    """Return map_server's value of one pixel."""
    counted = channels if mode == "trinary" or not has_alpha else channels[:-1]
    shade = sum(counted) / len(counted)
    if negate:
        shade = 255 - shade
    if mode == "raw":
        return int(shade) if int(shade) < 128 else int(shade) - 256
    darkness = (255 - shade) / 255.0
    if darkness > occupied:
        return 100
    if darkness < free:
        return 0
    if mode == "trinary" or (len(channels) > 1 and channels[-1] == 0):
        return -1
    return int(1 + 98 * (darkness - free) / (occupied - free))


# One image of each kind. Each function writes it, and returns its channels for map_server.

RANDOM = np.random.default_rng(7)
GREY = np.arange(256).reshape(8, 32)
COLOURS = RANDOM.integers(0, 256, (12, 17, 3))
CLEAR = np.concatenate((COLOURS, RANDOM.choice([0, 1, 127, 255], (12, 17, 1))), axis=2)
PALETTE = np.array([(7 * each) % 256 for each in range(768)])


def grey(folder):
    write_png(folder, GREY)
    return GREY[..., np.newaxis]


def colours(folder):
    write_png(folder, COLOURS)
    return COLOURS


def transparent_colours(folder):
    write_png(folder, CLEAR)
    return CLEAR


def transparent_grey(folder):
    """map_server's reader converts it to RGBA."""
    write_png(folder, CLEAR[..., 2:], "LA")
    return CLEAR[..., [2, 2, 2, 3]]


def black_and_white(folder):
    image = Image.fromarray((GREY % 3 * 127).astype(np.uint8)).convert("1", dither=0)
    image.save(str(folder / "map.png"))
    return (GREY[..., np.newaxis] % 3 == 2) * 255


def grey_of_16_bits(folder):
    """The lower eight bits are cut off."""
    pixels = RANDOM.integers(0, 65536, (6, 9)).astype(np.uint16)
    Image.fromarray(pixels).save(str(folder / "map.png"))
    return pixels[..., np.newaxis] // 256


def indexed(folder, **options):
    """The reader returns the indices."""
    image = Image.fromarray(GREY.astype(np.uint8), "P")
    image.putpalette(PALETTE.tolist())
    image.save(str(folder / "map.png"), **options)
    return GREY[..., np.newaxis]


def indexed_with_a_transparent_colour(folder):
    return indexed(folder, transparency=3)


def indexed_with_opaque_colours(folder):
    return indexed(folder, transparency=b"\xff" * 256)


def indexed_with_degrees_of_opacity(folder):
    """The reader returns the colours."""
    opacity = RANDOM.integers(0, 256, 256).astype(np.uint8)
    indexed(folder, transparency=opacity.tobytes())
    return np.concatenate((PALETTE.reshape(256, 3), opacity[:, np.newaxis]), axis=1)[GREY]


def raw_pgm(folder):
    (folder / "map.png").write_bytes(b"P5\n# a comment\n32 8\n255\n" + bytes(range(256)))
    return GREY[..., np.newaxis]


def raw_pgm_with_a_low_maximum(folder):
    shades = [*range(16), *range(15, -1, -1)]
    (folder / "map.png").write_bytes(b"P5 16 2 15 " + bytes(shades))
    return np.reshape(shades, (2, 16, 1)) * 255 // 15


def plain_pgm(folder):
    (folder / "map.png").write_text("P2\n3 2\n# shades\n100\n0 50 # half\n100 99\n1 33\n")
    return np.array([[[0], [127], [255]], [[252], [2], [84]]])


IMAGES = [
    grey,
    colours,
    transparent_colours,
    transparent_grey,
    black_and_white,
    grey_of_16_bits,
    indexed,
    indexed_with_a_transparent_colour,
    indexed_with_opaque_colours,
    indexed_with_degrees_of_opacity,
    raw_pgm,
    raw_pgm_with_a_low_maximum,
    plain_pgm,
]


@pytest.mark.parametrize("image", IMAGES, ids=lambda image: image.__name__)
@pytest.mark.parametrize("mode", MODES)
def test_every_pixel_has_map_servers_value(tmp_path, image, mode):
    channels = image(tmp_path)
    has_alpha = channels.shape[2] == 4
    for occupied, free, negate in ((0.65, 0.196, 0), (0.1, 0.09, 1), (1.0, 0.0, 0), (0.5, 0.5, 1)):
        if mode == "scale" and occupied == free:
            continue  # map_server divides by zero
        path = write_yaml(
            tmp_path, mode=mode, negate=negate, occupied_thresh=occupied, free_thresh=free
        )
        rule = (has_alpha, negate, occupied, free, mode)
        expected = [[expected_cell(each, *rule) for each in row] for row in channels.tolist()[::-1]]
        assert read_map(path).cells.tolist() == expected


def test_values_by_hand(tmp_path):
    write_png(tmp_path, [[0, 128, 255], [90, 89, 206]])
    # The darkness is 1, 0.498, 0 and, in the lower row, 0.647, 0.651, 0.192.
    for mode, expected in (
        ("trinary", [[-1, 100, 0], [100, -1, 0]]),
        ("scale", [[98, 100, 0], [100, 66, 0]]),
        ("raw", [[90, 89, -50], [0, -128, -1]]),
    ):
        assert read_map(write_yaml(tmp_path, mode=mode)).cells.tolist() == expected


def test_size_resolution_and_origin(tmp_path):
    write_png(tmp_path, np.zeros((3, 7)))
    grid = read_map(write_yaml(tmp_path, cost_scale="[1, {an: unknown key}]"))
    assert (grid.height, grid.width, grid.resolution) == (3, 7, 0.05)
    assert grid.origin == Pose(-1.0, 2.0, 0.3)
    # Numbers as YAML writes them; the resolution is rounded as in a message.
    numbers = {"resolution": "123456789e-9", "origin": "[1, -2, +.5]", "occupied_thresh": "1"}
    grid = read_map(write_yaml(tmp_path, **numbers))
    assert grid.origin == Pose(1.0, -2.0, 0.5)
    assert grid.resolution == as_travelled(0.123456789) != 0.123456789


def test_the_path_of_an_image(tmp_path):
    write_png(tmp_path, [[0]])
    (tmp_path / "below").mkdir()
    read_map(write_yaml(tmp_path / "below", image="../map.png"))
    read_map(write_yaml(tmp_path / "below", image=str(tmp_path / "map.png")))


@pytest.mark.parametrize(
    "changes, expected",
    [
        ({"resolution": None}, "resolution: is missing; expected a number from 0.0001 to 1000 m"),
        ({"resolution": "0"}, "resolution: is '0'; expected a number from 0.0001"),
        ({"resolution": ".nan"}, "resolution: is '.nan'; expected"),
        ({"resolution": "nan"}, "resolution: is 'nan'; expected"),
        ({"resolution": "1e999"}, "resolution: is '1e999'; expected"),
        ({"resolution": "[0.1]"}, "resolution: is ['0.1']; expected"),
        ({"resolution": "x" * 90}, f"resolution: is '{'x' * 56}...; expected"),
        ({"origin": None}, "origin: is missing; expected [x, y, yaw] in m, m, rad"),
        ({"origin": "[0, 0]"}, "origin: is ['0', '0']; expected [x, y, yaw]"),
        ({"origin": "[0, .inf, 0]"}, "origin: is ['0', '.inf', '0']; expected [x, y, yaw]"),
        ({"origin": "[0, 1e7, 0]"}, "each at most 1e+06"),
        ({"origin": "0"}, "origin: is '0'; expected [x, y, yaw]"),
        ({"occupied_thresh": "65"}, "occupied_thresh: is '65'; expected a number from 0 to 1"),
        ({"free_thresh": "-0.1"}, "free_thresh: is '-0.1'; expected a number from 0 to 1"),
        ({"free_thresh": "0.7"}, "free_thresh: 0.7; expected at most occupied_thresh, 0.65"),
        ({"negate": None}, "negate: is missing; expected 0, or 1 if white is a wall"),
        ({"negate": "2"}, "negate: is '2'; expected 0, or 1"),
        ({"negate": "[]"}, "negate: is []; expected 0, or 1"),
        ({"mode": "Trinary"}, "mode: is 'Trinary'; expected one of trinary, scale, raw"),
        ({"image": None}, "image: is missing; expected the path of a PNG or PGM image"),
        ({"image": "''"}, "image: is ''; expected the path"),
        ({"image": "none.png"}, "none.png': it cannot be read (No such file or directory)"),
        ({"image": "."}, "this is not a regular file; expected a PNG or PGM image"),
        ({"image": "map.yaml"}, "map.yaml': this is neither PNG nor PGM (P2 or P5)"),
        ({"image": '"a\\0b"'}, "embedded null"),
    ],
)
def test_a_broken_key(tmp_path, changes, expected):
    write_png(tmp_path, [[0]])
    path = write_yaml(tmp_path, **changes)
    message = faults_of(path)
    assert message.startswith(f"{path}: ")
    assert expected in message
    assert len(message.splitlines()) == 1


def test_one_line_for_each_broken_key(tmp_path):
    path = write_yaml(tmp_path, mode="[bad]", **dict.fromkeys(GOOD, "[bad]"))
    keys = [line.split(": ")[1] for line in faults_of(path).splitlines()]
    assert sorted(keys) == sorted([*GOOD, "mode"])


def test_a_broken_yaml_file(tmp_path):
    path = tmp_path / "map.yaml"
    path.write_text("- image")
    assert faults_of(str(path)).startswith(f"{path}: ")
    assert "expected a map's yaml file, with keys such as 'image: map.png'" in faults_of(str(path))


def png_of_size(width, height):
    """Return a PNG file without pixels, which claims a size."""
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)), (b"IDAT", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


@pytest.mark.parametrize(
    "data, expected",
    [
        (png_of_size(100_000, 100_000), "it has 100000 x 100000 pixels; expected at least 1"),
        (png_of_size(0, 5), "it cannot be read"),
        (png_of_size(5, 5), "it cannot be read (OSError"),
        (b"\x89PNG\r\n\x1a\n", "it cannot be read"),
        (b"P5 0 2 255 ", "it has 0 x 2 pixels"),
        (b"P5 100000 100000 255 ", "it has 100000 x 100000 pixels"),
        (b"P5 2 2 65535 12345678", "its maximum shade is 65535; expected 1 to 255"),
        (b"P5 2 2 0 1234", "its maximum shade is 0"),
        (b"P5 2 2 255 123", "it ends after 3 of 4 pixels"),
        (b"P2 2 2 255 1 2 3", "it ends after 3 of 4 pixels"),
        (b"P2 2 2 255 1 2 3 x", "a shade in it is not a number"),
        (b"P2 2 2 255 1 2 3 -4", "a shade in it is not a number"),
        (b"P5 two 2 255 1234", "its header is broken"),
        (b"P5", "its header is broken"),
        (b"GIF89a", "this is neither PNG nor PGM"),
        (b"", "this is neither PNG nor PGM"),
    ],
)
def test_a_broken_image(tmp_path, data, expected):
    (tmp_path / "map.png").write_bytes(data)
    assert expected in faults_of(write_yaml(tmp_path))


def test_other_images_that_cannot_be_used(tmp_path):
    write_png(tmp_path, [[0, 9]], transparency=9)
    assert "it is grey with a transparent shade" in faults_of(write_yaml(tmp_path))
    write_png(tmp_path, RANDOM.integers(0, 256, (50, 50)))
    data = (tmp_path / "map.png").read_bytes()
    for length in (30, 60, len(data) // 2):
        (tmp_path / "map.png").write_bytes(data[:length])
        assert "map.png': it cannot be read" in faults_of(write_yaml(tmp_path))


ODD_VALUES = (
    "|~|0|-0.0|1|0.5|2|1e-45|1e30|1e400|nan|.inf|0x1f|1_0|1:30|true|[]|[0, 0]|[1e6, -1e6, 1e-45]"
    "|[nan, 0, 0]|[[0], 0, 0]|{a: b}|map.png|/|..|'|[|&a b|*a|!!int 1|>|raw|\\0|\t|#"
).split("|")


@given(st.dictionaries(st.sampled_from([*GOOD, "mode"]), st.sampled_from(ODD_VALUES), max_size=3))
def test_any_values_make_a_map_or_an_error(tmp_path_factory, changes):
    folder = tmp_path_factory.mktemp("any")
    write_png(folder, [[0, 255]])
    try:
        grid = read_map(write_yaml(folder, **changes))
    except MapError as error:
        assert str(error).startswith(f"{folder}/map.yaml: ")
        return
    assert grid.cells.shape == (1, 2) and math.isfinite(sum(grid.origin))


@given(
    st.sampled_from([b"", b"P2 3 2 9 ", b"P5 3 2 9 ", png_of_size(3, 2)]), st.binary(max_size=100)
)
def test_any_bytes_make_an_image_or_an_error(tmp_path_factory, head, data):
    folder = tmp_path_factory.mktemp("any")
    (folder / "map.png").write_bytes(head + data)
    try:
        assert read_map(write_yaml(folder)).cells.shape == (2, 3)
    except MapError as error:
        assert "map.png': " in str(error)


def test_find_a_map(tmp_path, monkeypatch):
    path = write_yaml(tmp_path)
    sandbox = os.path.join(MAPS, "sandbox.yaml")
    assert find_map("sandbox", MAPS) == find_map("sandbox.yaml", MAPS) == sandbox
    (tmp_path / "map").touch()  # the name with .yaml has precedence over a file of that name
    assert find_map("map", str(tmp_path)) == path
    assert find_map(path, MAPS) == path
    monkeypatch.setenv("PWD", str(tmp_path))  # the user's directory, see user_path
    assert find_map("map.yaml", MAPS) == find_map("./map.yaml", MAPS) == path


@pytest.mark.parametrize("name", ["", "no_such_map", "/no/such/map.yaml", "a\0b"])
def test_no_such_map(name):
    with pytest.raises(MapError, match=r"no such map; expected .*: race_loop, rooms, sandbox"):
        find_map(name, MAPS)


def test_a_plain_pgm_map():
    grid = read_map(os.path.join(FIXTURES, "maps", "asymmetric.yaml"))
    assert grid.cells.tolist() == [
        [100, 100, 0, -1, 0],
        [100, 0, 0, 0, 0],
        [0, 0, 100, 0, -1],
    ]


def test_the_shipped_maps_are_those_of_make_maps(tmp_path):
    command = [os.path.join(PACKAGE, "scripts", "make_maps"), str(tmp_path)]
    subprocess.run(command, check=True, timeout=60)
    assert sorted(os.listdir(str(tmp_path))) == sorted(os.listdir(MAPS))
    for name in ("sandbox", "race_loop", "rooms"):
        made, shipped = (os.path.join(folder, name) for folder in (str(tmp_path), MAPS))
        with Image.open(f"{made}.png") as one, Image.open(f"{shipped}.png") as other:
            assert (one.mode, one.size) == (other.mode, other.size)
            assert one.tobytes() == other.tobytes(), name
        with open(f"{made}.yaml") as one, open(f"{shipped}.yaml") as other:
            assert one.read() == other.read(), name


def test_the_sandbox_is_mushrs():
    grid = read_map(os.path.join(MAPS, "sandbox.yaml"))
    assert (grid.resolution, grid.origin) == (0.1, Pose(-50.0, -50.0, 0.0))
    assert grid.cells.shape == (1000, 1000)
    free = np.zeros((1000, 1000), bool)
    free[6:-6, 6:-6] = True
    assert (grid.cells == np.where(free, 0, 100)).all()
