"""Map files: the cells of every kind of image as map_server has them, and errors."""

import io

import numpy as np
import pytest
from PIL import Image

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.world.grid import as_travelled
from mushr_ros_intro.world.map_file import read_map

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
    lines = [f"{key}: {value}\n" for key, value in keys.items() if value is not None]
    path = folder / "map.yaml"
    path.write_text("".join(lines))
    return str(path)


def write_png(folder, pixels, mode="L"):
    """Write an image in one of Pillow's modes; row 0 of the pixels is at the top."""
    kind, mode = (bool, None) if mode == "1" else (np.uint8, mode)
    Image.fromarray(np.asarray(pixels, kind), mode).save(str(folder / "map.png"))


def fault_of(path):
    with pytest.raises(UserError) as caught:
        read_map(path)
    return str(caught.value)


def expected_cell(channels, negate, occupied, free):
    """Return map_server's value of one pixel."""
    shade = sum(channels) / len(channels)
    if negate:
        shade = 255 - shade
    darkness = (255 - shade) / 255.0
    if darkness > occupied:
        return 100
    return 0 if darkness < free else -1


# One image of each kind: Pillow's mode, its pixels, and the channels that map_server decodes.

RANDOM = np.random.default_rng(7)
GREY = np.arange(256).reshape(8, 32)
COLOURS = RANDOM.integers(0, 256, (12, 17, 3))
CLEAR = np.concatenate((COLOURS, RANDOM.choice([0, 1, 127, 255], (12, 17, 1))), axis=2)
BITS = GREY % 3 == 2

IMAGES = {
    "grey": ("L", GREY, GREY[..., np.newaxis]),
    "colours": ("RGB", COLOURS, COLOURS),
    "colours with opacity": ("RGBA", CLEAR, CLEAR),
    "grey with opacity": ("LA", CLEAR[..., 2:], CLEAR[..., [2, 2, 2, 3]]),
    "black and white": ("1", BITS, BITS[..., np.newaxis] * 255),
}


@pytest.mark.parametrize("kind", IMAGES)
def test_every_pixel_has_map_servers_value(tmp_path, kind):
    image_mode, pixels, channels = IMAGES[kind]
    write_png(tmp_path, pixels, image_mode)
    for occupied, free, negate in ((0.65, 0.196, 0), (0.1, 0.09, 1), (1.0, 0.0, 0), (0.5, 0.5, 1)):
        limits = {"occupied_thresh": occupied, "free_thresh": free}
        path = write_yaml(tmp_path, negate=negate, **limits)
        rule = (negate, occupied, free)
        expected = [[expected_cell(each, *rule) for each in row] for row in channels.tolist()[::-1]]
        assert read_map(path).cells.tolist() == expected


def test_a_pgm_image_in_another_folder(tmp_path):
    (tmp_path / "map.png").write_bytes(b"P5\n# a comment\n32 8\n255\n" + bytes(range(256)))
    cells = read_map(write_yaml(tmp_path, mode="trinary")).cells
    darkness = (255 - GREY[::-1]) / 255
    assert (cells == np.where(darkness > 0.65, 100, np.where(darkness < 0.196, 0, -1))).all()
    (tmp_path / "below").mkdir()
    for image in ("../map.png", str(tmp_path / "map.png")):
        read_map(write_yaml(tmp_path / "below", image=image))


def test_what_map_server_accepts(tmp_path):
    """A tab behind a key, more documents, and a comment in Latin-1."""
    write_png(tmp_path, [[0]])
    path = write_yaml(tmp_path, resolution=None)
    with open(path, "ab") as file:
        file.write(b"resolution:\t0.05 # caf\xe9\n---\nanother: [document\n")
    assert read_map(path).resolution == 0.05


def test_a_large_image(tmp_path, monkeypatch, recwarn):
    """Pillow warns of an image of 10000 x 10000 pixels."""
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1)
    write_png(tmp_path, [[0, 0]])
    assert read_map(write_yaml(tmp_path)).width == 2
    assert [str(each.message) for each in recwarn] == []


def test_values_by_hand(tmp_path):
    write_png(tmp_path, [[0, 128, 255], [90, 89, 206]])
    # The darkness is 1, 0.498, 0 and, in the lower row, 0.647, 0.651, 0.192.
    cells = read_map(write_yaml(tmp_path)).cells.tolist()
    assert cells == [[-1, 100, 0], [100, -1, 0]]


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


@pytest.mark.parametrize(
    "changes, expected",
    [
        ({"resolution": None}, "resolution is not set; expected a number from 0.0001 to 1000 m"),
        ({"resolution": "0"}, "resolution is 0; expected a number from 0.0001"),
        ({"resolution": "nan"}, "resolution is 'nan'; expected"),
        ({"origin": None}, "origin is not set; expected [x, y, yaw] in m, m, rad"),
        ({"origin": "[0, 0]"}, "origin is [0, 0]; expected [x, y, yaw]"),
        ({"origin": "[-1100000, 0, 0]"}, "origin: x is -1100000; expected a number"),
        ({"origin": "[0, .inf, 0]"}, "origin: y is inf; expected a number from -1e+06 to 1e+06 m"),
        ({"origin": "[0, 0, a]"}, "origin: yaw is 'a'; expected a number from -1e+06"),
        ({"occupied_thresh": "65"}, "occupied_thresh is 65; expected a number from 0 to 1"),
        ({"free_thresh": "-0.1"}, "free_thresh is -0.1; expected a number from 0 to"),
        ({"free_thresh": "0.7"}, "free_thresh is 0.7; expected a number from 0 to 0.65"),
        ({"negate": None}, "negate is not set; expected a whole number from 0 to 1"),
        ({"negate": "2"}, "negate is 2; expected a whole number from 0 to 1"),
        ({"mode": "scale"}, "mode is 'scale'; expected one of trinary"),
        ({"image": None}, "image is not set; expected the path of a PNG or PGM image"),
        ({"image": "none.png"}, "none.png': No such file or directory; expected a PNG or PGM"),
        ({"image": "."}, "Is a directory; expected a PNG or PGM image"),
        ({"image": "map.pbm"}, "expected a PNG or PGM image"),
        ({"negate": "0\nnegate: 1"}, "the key 'negate' is there twice"),
        ({"image": "map.yaml"}, "cannot identify image file"),
        ({"image": '"a\\0b"'}, "embedded null"),
    ],
)
def test_a_broken_key(tmp_path, changes, expected):
    write_png(tmp_path, [[0]])
    (tmp_path / "map.pbm").write_bytes(b"P4\n8 1\n\xf0")
    path = write_yaml(tmp_path, **changes)
    message = fault_of(path)
    assert f"{path}: " in message
    assert expected in message
    assert len(message.splitlines()) == 1
    (tmp_path / "map.yaml").write_text("- image")
    assert "expected a map's yaml file, with keys such as 'image: map.png'" in fault_of(path)


def saved(mode, name, **options):
    """Return the bytes of an image of two pixels."""
    file = io.BytesIO()
    Image.new(mode, (2, 1)).save(file, name, **options)
    return file.getvalue()


@pytest.mark.parametrize(
    "data, expected",
    [
        (saved("P", "PNG"), "this is a PNG image of Pillow's mode P"),
        (saved("L", "PNG", transparency=9), "this is a PNG image of Pillow's mode L"),
        (saved("I", "PNG"), "this is a PNG image of Pillow's mode I"),
        (saved("L", "GIF"), "this is a GIF image"),
        (saved("L", "PNG")[:40], ""),
        (b"P5 100000 100000 255 ", "exceeds limit"),
        (b"P5 0 2 255 ", ""),
        (b"P5 2 2 65535 12345678", "Pillow's mode I"),
        (b"P5 2 2 255 123", ""),
        (b"P5", ""),
        (b"", "cannot identify image file"),
    ],
)
def test_a_broken_image(tmp_path, data, expected):
    (tmp_path / "map.png").write_bytes(data)
    message = fault_of(write_yaml(tmp_path))
    assert expected in message
    assert "map.png': " in message and "; expected a PNG or PGM image, grey or RGB" in message
