"""Maps: what each pixel becomes, against map_server's rule pixel by pixel, and what is refused."""

import math
import os
import struct
import subprocess

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from mushr_ros_intro.car.bicycle import ORIGIN, Pose, compose
from mushr_ros_intro.world.grid import Grid, as_travelled
from mushr_ros_intro.world.map_file import (
    MAX_CELLS,
    MAX_YAML_SIZE,
    MODES,
    MapError,
    find_map,
    read_map,
)
from support.paths import PACKAGE

MAPS = os.path.join(PACKAGE, "maps")

ROUNDING = 1e-12
"""[m, rad] Of sums of coordinates within a hundred metres."""

GOOD = {
    "image": "map.png",
    "resolution": "0.05",
    "origin": "[-1.0, 2.0, 0.3]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}


def write_yaml(folder, **changes):
    """Write a map's yaml file, good but for the changes; None leaves a key out."""
    keys = {**GOOD, **changes}
    path = os.path.join(str(folder), "map.yaml")
    with open(path, "w") as file:
        file.writelines(f"{key}: {value}\n" for key, value in keys.items() if value is not None)
    return path


def write_png(folder, pixels, mode="L", name="map.png", **options):
    """Write a picture, its pixels as an array, row 0 at the top."""
    Image.fromarray(np.asarray(pixels, np.uint8), mode).save(
        os.path.join(str(folder), name), **options
    )


def faults_of(path):
    with pytest.raises(MapError) as caught:
        read_map(path)
    return str(caught.value)


def expected_cell(channels, has_alpha, negate, occupied, free, mode):
    """Return what map_server makes of one pixel, worked out one step at a time."""
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


def expected_cells(rows, *rule):
    return [[expected_cell(pixel, *rule) for pixel in row] for row in rows[::-1]]


# A picture of every kind, and its channels as map_server's reader has them.

RANDOM = np.random.default_rng(7)
GREY = np.arange(256).reshape(8, 32)
COLOURS = RANDOM.integers(0, 256, (12, 17, 3))
CLEAR = np.concatenate((COLOURS, RANDOM.choice([0, 1, 127, 255], (12, 17, 1))), axis=2)


def grey(folder):
    write_png(folder, GREY)
    return GREY[..., np.newaxis], False


def colours(folder):
    write_png(folder, COLOURS, "RGB")
    return COLOURS, False


def clear_colours(folder):
    write_png(folder, CLEAR, "RGBA")
    return CLEAR, True


def clear_grey(folder):
    """Grey with opacity: the reader makes it RGBA."""
    write_png(folder, CLEAR[..., 2:], "LA")
    return CLEAR[..., [2, 2, 2, 3]], True


def black_and_white(folder):
    image = Image.fromarray((GREY % 3 * 127).astype(np.uint8)).convert("1", dither=0)
    image.save(os.path.join(str(folder), "map.png"))
    return (GREY[..., np.newaxis] % 3 == 2) * 255, False


def deep_grey(folder):
    """16 bits a pixel: the lower eight are cut off."""
    pixels = RANDOM.integers(0, 65536, (6, 9)).astype(np.uint16)
    Image.fromarray(pixels).save(os.path.join(str(folder), "map.png"))
    return pixels[..., np.newaxis] // 256, False


def indexed(folder, transparency=None):
    """Indexed colours: the reader hands over the indices."""
    image = Image.fromarray(GREY.astype(np.uint8), "P")
    image.putpalette([(7 * each) % 256 for each in range(768)])
    options = {} if transparency is None else {"transparency": transparency}
    image.save(os.path.join(str(folder), "map.png"), **options)
    return GREY[..., np.newaxis], False


def indexed_with_a_clear_colour(folder):
    return indexed(folder, transparency=3)


def indexed_with_shades_of_opacity(folder):
    """Then it is the colours."""
    opacity = RANDOM.integers(0, 256, 256).astype(np.uint8)
    indexed(folder, transparency=opacity.tobytes())
    palette = np.array([(7 * each) % 256 for each in range(768)]).reshape(256, 3)
    return np.concatenate((palette, opacity[:, np.newaxis]), axis=1)[GREY], True


def raw_pgm(folder):
    with open(os.path.join(str(folder), "map.png"), "wb") as file:
        file.write(b"P5\n# a comment\n32 8\n255\n" + bytes(range(256)))
    return GREY[..., np.newaxis], False


def raw_pgm_of_few_shades(folder):
    with open(os.path.join(str(folder), "map.png"), "wb") as file:
        file.write(b"P5 16 2 15 " + bytes(range(16)) + bytes(range(15, -1, -1)))
    shades = np.array([list(range(16)), list(range(15, -1, -1))])
    return shades[..., np.newaxis] * 255 // 15, False


def plain_pgm(folder):
    with open(os.path.join(str(folder), "map.png"), "w") as file:
        file.write("P2\n3 2\n# shades\n100\n0 50 # half\n100 99\n1 33\n")
    return np.array([[[0], [127], [255]], [[252], [2], [84]]]), False


PICTURES = [
    grey,
    colours,
    clear_colours,
    clear_grey,
    black_and_white,
    deep_grey,
    indexed,
    indexed_with_a_clear_colour,
    indexed_with_shades_of_opacity,
    raw_pgm,
    raw_pgm_of_few_shades,
    plain_pgm,
]


@pytest.mark.parametrize("picture", PICTURES, ids=lambda picture: picture.__name__)
@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("mode", MODES)
def test_every_pixel_becomes_what_map_server_makes_of_it(tmp_path, picture, negate, mode):
    channels, has_alpha = picture(tmp_path)
    for occupied, free in ((0.65, 0.196), (0.1, 0.09), (0.5, 0.5), (1.0, 0.0)):
        if mode == "scale" and occupied == free:
            continue  # map_server divides by zero
        path = write_yaml(
            tmp_path, mode=mode, negate=negate, occupied_thresh=occupied, free_thresh=free
        )
        expected = expected_cells(channels.tolist(), has_alpha, negate, occupied, free, mode)
        assert read_map(path).cells.tolist() == expected


def test_values_that_were_worked_out_by_hand(tmp_path):
    write_png(tmp_path, [[0, 128, 255], [90, 89, 206]])
    # The darkness is 1, 0.498, 0 and, in the lower row, 0.647, 0.651, 0.192.
    path = write_yaml(tmp_path)
    assert read_map(path).cells.tolist() == [[-1, 100, 0], [100, -1, 0]]
    path = write_yaml(tmp_path, mode="scale")
    assert read_map(path).cells.tolist() == [[98, 100, 0], [100, 66, 0]]
    path = write_yaml(tmp_path, mode="raw")
    assert read_map(path).cells.tolist() == [[90, 89, -50], [0, -128, -1]]


def test_a_grid_knows_its_size_and_place(tmp_path):
    write_png(tmp_path, np.zeros((3, 7)))
    grid = read_map(write_yaml(tmp_path))
    assert (grid.height, grid.width, grid.resolution) == (3, 7, 0.05)
    assert grid.origin == Pose(-1.0, 2.0, 0.3)
    assert grid.occupied.all()


def test_a_grid_has_the_resolution_that_travels(tmp_path):
    write_png(tmp_path, [[0]])
    resolution = read_map(write_yaml(tmp_path, resolution="0.123456789")).resolution
    assert resolution == as_travelled(0.123456789) != 0.123456789


def test_a_picture_becomes_the_same_cells_block_by_block(tmp_path, monkeypatch):
    """Three rows at a time, and the last two."""
    write_png(tmp_path, [[0, 255], [0, 255], [255, 0], [255, 0], [255, 255]])
    path = write_yaml(tmp_path)
    expected = [[0, 0], [0, 100], [0, 100], [100, 0], [100, 0]]
    assert read_map(path).cells.tolist() == expected
    monkeypatch.setattr("mushr_ros_intro.world.map_file._BLOCK", 6)
    assert read_map(path).cells.tolist() == expected


def test_the_shipped_example_of_a_plain_picture():
    grid = read_map(os.path.join(PACKAGE, "test", "fixtures", "maps", "asymmetric.yaml"))
    assert grid.cells.tolist() == [
        [100, 100, 0, -1, 0],
        [100, 0, 0, 0, 0],
        [0, 0, 100, 0, -1],
    ]
    assert grid.occupied.sum() == 4


def test_numbers_as_yaml_writes_them(tmp_path):
    write_png(tmp_path, [[0]])
    path = write_yaml(tmp_path, resolution="5e-2", origin="[1, -2, +.5]", occupied_thresh="1")
    grid = read_map(path)
    assert (grid.resolution, grid.origin) == (0.05, Pose(1.0, -2.0, 0.5))


def test_keys_that_map_server_passes_over(tmp_path):
    write_png(tmp_path, [[0]])
    read_map(write_yaml(tmp_path, cost_scale="[1, {a: b}]"))


def test_a_picture_elsewhere(tmp_path):
    write_png(tmp_path, [[0]], name="away.png")
    read_map(write_yaml(tmp_path, image=str(tmp_path / "away.png")))
    (tmp_path / "below").mkdir()
    read_map(write_yaml(tmp_path / "below", image="../away.png"))


@pytest.mark.parametrize(
    "changes, expected",
    [
        ({"resolution": None}, "resolution: is missing; expected a number from 0.0001 to 1000 m"),
        ({"resolution": "0"}, "resolution: is '0'; expected a number from 0.0001"),
        ({"resolution": "-0.1"}, "resolution: is '-0.1'; expected"),
        ({"resolution": ".nan"}, "resolution: is '.nan'; expected"),
        ({"resolution": "nan"}, "resolution: is 'nan'; expected"),
        ({"resolution": "1e999"}, "resolution: is '1e999'; expected"),
        ({"resolution": "[0.1]"}, "resolution: is ['0.1']; expected"),
        ({"resolution": "fine"}, "resolution: is 'fine'; expected"),
        ({"origin": None}, "origin: is missing; expected [x, y, yaw] in m, m, rad"),
        ({"origin": "[0, 0]"}, "origin: is ['0', '0']; expected [x, y, yaw]"),
        ({"origin": "[0, 0, 0, 0]"}, "origin: is ['0', '0', '0', '0']; expected [x, y, yaw]"),
        ({"origin": "[0, .inf, 0]"}, "origin: is ['0', '.inf', '0']; expected [x, y, yaw]"),
        ({"origin": "[0, 1e7, 0]"}, "each at most 1e+06"),
        ({"origin": "0"}, "origin: is '0'; expected [x, y, yaw]"),
        ({"occupied_thresh": "65"}, "occupied_thresh: is '65'; expected a number from 0 to 1"),
        ({"free_thresh": None}, "free_thresh: is missing; expected a number from 0 to 1"),
        ({"free_thresh": "0.7"}, "free_thresh: 0.7; expected not more than occupied_thresh, 0.65"),
        ({"negate": None}, "negate: is missing; expected 0, or 1 where white is a wall"),
        ({"negate": "2"}, "negate: is '2'; expected 0, or 1"),
        ({"negate": "[]"}, "negate: is []; expected 0, or 1"),
        ({"mode": "Trinary"}, "mode: is 'Trinary'; expected trinary, scale, raw"),
        ({"mode": "[raw]"}, "mode: is ['raw']; expected trinary, scale, raw"),
        ({"image": None}, "image: is missing; expected the path of a PNG or PGM picture"),
        ({"image": "''"}, "image: is ''; expected the path"),
        ({"image": "none.png"}, "none.png': it cannot be read (No such file or directory)"),
        ({"image": "."}, "this is not a regular file; expected a PNG or PGM picture"),
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


def test_all_faults_in_one_message(tmp_path):
    changes = dict.fromkeys(GOOD, "[bad]")
    message = faults_of(write_yaml(tmp_path, mode="[bad]", **changes))
    keys = [line.split(": ")[1] for line in message.splitlines()]
    assert sorted(keys) == sorted([*GOOD, "mode"])


NESTED = "[" * 30_000


@pytest.mark.parametrize(
    "text, expected",
    [
        ("", "the file has no keys; expected such as 'image: map.png'"),
        ("- image", "the file has no keys; expected such as"),
        ("a: [1, 2\nb: 3", "expected yaml"),
        ("a: b: c", "line 1, column 5: "),
        ("a: \x01", "expected yaml"),
        ("a: &x 1\nb: *x", "line 2, column 4: found an alias; expected yaml"),
        ("a: " + NESTED, "this is nested too deeply"),
        ("#" * (MAX_YAML_SIZE + 1), "the file has more than 65536 bytes"),
        ("? [a]\n: b", "expected yaml"),
    ],
    ids=["empty", "list", "open", "twice", "control", "alias", "nested", "large", "key"],
)
def test_what_is_no_yaml_of_a_map(tmp_path, text, expected):
    path = tmp_path / "map.yaml"
    path.write_text(text)
    message = faults_of(str(path))
    assert message.startswith(f"{path}: ")
    assert expected in message
    assert len(message) < 500


def test_a_few_lines_that_stand_for_more_than_fits_in_memory(tmp_path):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    for number in range(1, 30):
        lines.append(f"a{number}: &a{number} [{', '.join([f'*a{number - 1}'] * 9)}]")
    path = tmp_path / "map.yaml"
    path.write_text("\n".join(lines) + "\nresolution: *a29\n")
    assert "found an alias" in faults_of(str(path))


def test_files_that_cannot_be_read(tmp_path):
    assert "No such file or directory" in faults_of(str(tmp_path / "none.yaml"))
    assert "this is a directory; expected a map's yaml file" in faults_of(str(tmp_path))
    os.mkfifo(str(tmp_path / "pipe"))
    assert "not a regular file" in faults_of(str(tmp_path / "pipe"))
    assert "expected a map's yaml file" in faults_of("a\0b")


def png_of_size(width, height):
    """Return the head of a PNG file that says it has a size."""
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", len(header)) + b"IHDR" + header + b"\0" * 8


@pytest.mark.parametrize(
    "data, expected",
    [
        (png_of_size(100_000, 100_000), "it has 100000 x 100000 pixels; expected at least 1"),
        (png_of_size(0, 5), "it has 0 x 5 pixels"),
        (png_of_size(5, 5), "it cannot be decoded"),
        (b"\x89PNG\r\n\x1a\n", "this is neither PNG nor PGM"),
        (b"P5 100000 100000 255 ", "it has 100000 x 100000 pixels"),
        (b"P5 2 2 65535 12345678", "its whitest shade is 65535; expected 1 to 255"),
        (b"P5 2 2 0 1234", "its whitest shade is 0"),
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
def test_a_broken_picture(tmp_path, data, expected):
    (tmp_path / "map.png").write_bytes(data)
    assert expected in faults_of(write_yaml(tmp_path))


def test_a_grey_picture_with_a_transparent_shade(tmp_path):
    write_png(tmp_path, [[0, 9]], transparency=9)
    assert "it is grey with a transparent shade" in faults_of(write_yaml(tmp_path))


def test_a_truncated_picture(tmp_path):
    write_png(tmp_path, RANDOM.integers(0, 256, (50, 50)))
    data = (tmp_path / "map.png").read_bytes()
    for length in (30, 60, len(data) // 2):
        (tmp_path / "map.png").write_bytes(data[:length])
        assert "map.png': it cannot be decoded" in faults_of(write_yaml(tmp_path))


def test_a_hundred_million_cells(tmp_path):
    side = 10_000
    image = Image.new("1", (side, side), 1)
    image.putpixel((3, side - 1 - 5), 0)
    image.save(str(tmp_path / "map.png"))
    cells = read_map(write_yaml(tmp_path)).cells
    assert cells.shape == (side, side)
    assert side * side <= MAX_CELLS
    assert cells[5, 3] == 100
    assert np.count_nonzero(cells) == 1


@given(st.binary(max_size=300))
def test_any_bytes_for_a_yaml(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "map.yaml"
    path.write_bytes(data)
    with pytest.raises(MapError):
        read_map(str(path))


odd = [
    "",
    "~",
    "0",
    "-0.0",
    "1",
    "0.5",
    "2",
    "1e-45",
    "1e30",
    "1e400",
    "nan",
    ".inf",
    "0x1f",
    "1_0",
]
odd += [
    "1:30",
    "true",
    "[]",
    "[0, 0]",
    "[1e6, -1e6, 1e-45]",
    "[nan, 0, 0]",
    "[[0], 0, 0]",
    "{a: b}",
]
odd += ["map.png", "/", "..", "'", "[", "&a b", "*a", "!!int 1", "|", "raw", "\\0", "\t", "#"]


@given(st.dictionaries(st.sampled_from([*GOOD, "mode"]), st.sampled_from(odd), max_size=3))
def test_any_values_for_the_keys_of_a_yaml(tmp_path_factory, changes):
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
def test_any_bytes_for_a_picture(tmp_path_factory, head, data):
    folder = tmp_path_factory.mktemp("any")
    (folder / "map.png").write_bytes(head + data)
    try:
        assert read_map(write_yaml(folder)).cells.shape == (2, 3)
    except MapError as error:
        assert "map.png': " in str(error)


def test_a_grid_does_not_change():
    cells = np.zeros((2, 3), np.int8)
    grid = Grid(cells, 0.1)
    with pytest.raises(ValueError):
        grid.cells[0, 0] = 1
    with pytest.raises(AttributeError):
        grid.resolution = 1.0
    cells[0, 0] = 1  # what it was made from is still its owner's
    assert grid.cells[0, 0] == 0


@pytest.mark.parametrize(
    "cells, resolution, origin",
    [
        (np.zeros((0, 3), np.int8), 0.1, ORIGIN),
        (np.zeros(3, np.int8), 0.1, ORIGIN),
        (np.zeros((2, 3), float), 0.1, ORIGIN),
        (np.zeros((2, 3), np.int8), 0.0, ORIGIN),
        (np.zeros((2, 3), np.int8), math.nan, ORIGIN),
        (np.zeros((2, 3), np.int8), 0.1, Pose(0.0, math.inf, 0.0)),
    ],
)
def test_impossible_grids(cells, resolution, origin):
    with pytest.raises(ValueError, match="expected"):
        Grid(cells, resolution, origin)


def test_the_smallest_and_the_largest_cells():
    for resolution in (1e-4, 1e3):
        assert Grid(np.zeros((1, 1), np.int8), resolution).resolution == resolution


def test_the_threshold_of_what_is_a_wall():
    grid = Grid(np.array([[-128, -1, 0, 50, 51, 100]], np.int8), 0.1)
    assert grid.occupied.tolist() == [[False, False, False, False, True, True]]


def test_the_frame_of_a_grid():
    grid = Grid(np.zeros((2, 3), np.int8), 0.1, Pose(3.0, -4.0, 2.0))
    there = Pose(0.7, 0.1, -1.0)
    back = grid.to_grid(compose(grid.origin, there))
    assert all(abs(got - wanted) < ROUNDING for got, wanted in zip(back, there))


@pytest.mark.parametrize("resolution", [0.1, 0.05, 0.025, 1.0, 0.03, 12.5, 0.0001])
def test_a_resolution_of_few_digits_travels_unchanged(resolution):
    assert as_travelled(resolution) == resolution
    field = struct.unpack("f", struct.pack("f", resolution))[0]
    assert as_travelled(field) == resolution


@given(st.floats(1e-4, 1e3))
def test_a_resolution_travels_once(resolution):
    once = as_travelled(resolution)
    assert as_travelled(struct.unpack("f", struct.pack("f", once))[0]) == once


def test_finding_a_map(tmp_path):
    write_png(tmp_path, [[0]])
    path = write_yaml(tmp_path)
    elsewhere = str(tmp_path)
    assert find_map("sandbox", MAPS) == os.path.join(MAPS, "sandbox.yaml")
    assert find_map("sandbox.yaml", MAPS) == os.path.join(MAPS, "sandbox.yaml")
    (tmp_path / "map").touch()  # a file of the bare name does not hide the yaml
    assert find_map("map", elsewhere) == path
    assert find_map("./map.yaml", MAPS, ["/", elsewhere]) == os.path.join(elsewhere, "./map.yaml")
    assert find_map(path, MAPS) == path


@pytest.mark.parametrize("name", ["", "no_such_map", "/no/such/map.yaml", "a\0b"])
def test_not_finding_a_map(name):
    with pytest.raises(MapError, match=r"no such map; expected .*: race_loop, rooms, sandbox"):
        find_map(name, MAPS)


def test_the_shipped_maps_are_what_the_script_draws(tmp_path):
    subprocess.run(
        [os.path.join(PACKAGE, "scripts", "make_maps"), str(tmp_path)], check=True, timeout=60
    )
    names = sorted(os.listdir(str(tmp_path)))
    assert names == sorted(os.listdir(MAPS))
    for name in names:
        made, shipped = os.path.join(str(tmp_path), name), os.path.join(MAPS, name)
        if name.endswith(".png"):
            with Image.open(made) as one, Image.open(shipped) as other:
                assert (one.mode, one.size) == (other.mode, other.size)
                assert one.tobytes() == other.tobytes(), name
        else:
            with open(made) as one, open(shipped) as other:
                assert one.read() == other.read(), name


def test_sandbox_is_mushr_s():
    grid = read_map(os.path.join(MAPS, "sandbox.yaml"))
    assert grid.cells.shape == (1000, 1000)
    assert (grid.resolution, grid.origin) == (0.1, Pose(-50.0, -50.0, 0.0))
    free = grid.cells == 0
    assert free[6:-6, 6:-6].all()
    assert free.sum() == 988 * 988
    assert (grid.cells[~free] == 100).all()
