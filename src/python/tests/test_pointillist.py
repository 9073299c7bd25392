"""Tests of the package: python3 -m unittest discover src/python/tests"""

import json
import os
import signal
import tempfile
import threading
import time
import unittest
import warnings

import numpy as np
import pointillist

SIZE = (96, 64)
NO_POINT = 0xFFFFFFFF


def ball(count=20_000, kind=np.float64):
    """Returns points of a ball of radius 1 and their colours."""
    random = np.random.default_rng(1)
    points = random.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    return points.astype(kind), (127.5 + 127.5 * points).astype(np.uint8)


def write_ply(path, points, colors):
    rows = np.zeros(len(points), [("p", "<f8", 3), ("c", "u1", 3)])
    rows["p"], rows["c"] = points, colors
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    with open(path, "wb") as file:
        file.write((header + "end_header\n").encode() + rows.tobytes())


class Pictures(unittest.TestCase):
    def test_points_are_drawn(self):
        for kind in (np.float32, np.float64):
            points, colors = ball(kind=kind)
            picture = pointillist.render(points, colors, size=SIZE, background="204060")
            self.assertEqual((picture.shape, picture.dtype), ((64, 96, 4), np.uint8))
            self.assertEqual(picture[0, 0].tolist(), [0x20, 0x40, 0x60, 255])
            self.assertNotEqual(picture[32, 48].tolist(), [0x20, 0x40, 0x60, 255])
            self.assertTrue((picture[..., 3] == 255).all())

    def test_colors_of_all_kinds_are_the_same(self):
        points, colors = ball()
        draw = lambda colors: pointillist.render(points, colors, "top", SIZE, style="points")
        expected = draw(colors)
        self.assertTrue((draw(colors.astype(np.uint16) * 257) == expected).all())
        self.assertTrue((draw(colors / 255) == expected).all())
        self.assertTrue((draw((colors / 255).astype(np.float32)) == expected).all())
        self.assertFalse((draw(255 - colors) == expected).all())

    def test_arrays_of_any_layout_are_the_same(self):
        points, colors = ball()
        expected = pointillist.render(points, colors, size=SIZE)
        for other in (np.asfortranarray(points), np.repeat(points, 2, axis=0)[::2], points.tolist()):
            self.assertTrue((pointillist.render(other, colors, size=SIZE) == expected).all())

    def test_no_points_are_a_picture(self):
        picture = pointillist.render(np.zeros((0, 3)), size=SIZE, style="points")
        self.assertTrue((picture == picture[0, 0]).all())

    def test_what_is_wrong_is_said(self):
        points, colors = ball(100)
        for arguments, options, said in [
            ((points[:, :2],), {}, "points must be an array of n x 3"),
            ((points, colors[:50]), {}, "50 colours for 100 positions"),
            ((points, colors.astype(np.int64)), {}, "colors are int64"),
            ((points, colors.astype(np.float64)), {}, "within 0 and 1"),
            ((points,), {"classes": colors}, "arrays of n values"),
            ((points,), {"style": "none"}, "invalid value 'none' for '--style"),
            ((points,), {"effects": ["edl=perhaps"]}, "--effect"),
            ((points,), {"no_such": 1}, "--no-such"),
            ((points,), {"size": (0, 5)}, "0x5"),
            ((points,), {"camera": {"eye": [0, 0, 1]}}, "missing field `target`"),
        ]:
            with self.assertRaisesRegex(ValueError, said):
                pointillist.render(*arguments, **{"size": SIZE, **options})
        with self.assertRaisesRegex(pointillist.Error, "no-such.json"):
            pointillist.render(points, camera="no-such.json", size=SIZE)
        with self.assertRaisesRegex(pointillist.Error, "no device|no Vulkan device|matches"):
            pointillist.render(points, device="no such device", size=SIZE)


class Renderers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.renderer = pointillist.Renderer(validate=True)

    def setUp(self):
        for cloud in self.renderer.clouds:
            self.renderer.remove(cloud)

    def test_layers_are_those_of_the_ball(self):
        points, colors = ball()
        self.renderer.add_points(points, colors)
        camera = {"eye": np.array([0.0, -5.0, 0.0]), "target": (0, 0, 0), "fov_y": 40}
        names = ["rgba", "linear", "depth", "id", "normal", "position"]
        layers = self.renderer.layers(names, camera, SIZE, effects=["phong=on"])
        self.assertEqual(list(layers), names)
        shapes = {name: (array.shape[2:], array.dtype) for name, array in layers.items()}
        self.assertEqual(shapes["rgba"], ((4,), np.uint8))
        self.assertEqual(shapes["linear"], ((4,), np.float32))
        self.assertEqual(shapes["depth"], ((), np.float32))
        self.assertEqual(shapes["id"], ((), np.uint32))
        self.assertEqual(shapes["position"], ((3,), np.float64))
        depth, position = layers["depth"], layers["position"]
        self.assertEqual(depth[0, 0], np.inf)
        self.assertAlmostEqual(depth[32, 48], 4.0, delta=0.01)
        known = layers["id"] != NO_POINT
        self.assertGreater(known.sum(), 500)
        self.assertTrue((np.isnan(position).any(axis=2) == ~known).all())
        # Each is one of the points that were given.
        nearest = np.abs(points[None] - position[known][:50, None]).max(axis=2).min(axis=1)
        self.assertLess(nearest.max(), 1e-6)
        self.assertTrue((np.abs(5 + position[known][:, 1] - depth[known]) < 1e-5).all())
        # The normal in the middle of the ball looks at the camera.
        self.assertGreater(abs(layers["normal"][32, 48][1]), 0.95)

    def test_clouds_are_shown_hidden_and_removed(self):
        points, colors = ball()
        one = self.renderer.add_points(points, colors)
        camera = self.renderer.camera("iso", SIZE)
        self.assertEqual(camera["projection"], "orthographic")
        alone = self.renderer.render(camera, SIZE)
        other = self.renderer.add_points(points * 2, 255 - colors)
        self.assertEqual(self.renderer.clouds, [one, other])
        self.assertFalse((self.renderer.render(camera, SIZE) == alone).all())
        self.renderer.show(other, False)
        self.assertTrue((self.renderer.render(camera, SIZE) == alone).all())
        self.renderer.show(other)
        self.renderer.remove(other)
        self.assertTrue((self.renderer.render(camera, SIZE) == alone).all())
        with self.assertRaisesRegex(ValueError, f"no cloud {other}"):
            self.renderer.show(other)

    def test_options_hold_until_they_are_taken_away(self):
        self.renderer.add_points(*ball())
        usual = self.renderer.render(size=SIZE)
        self.renderer.set(style="points", background="ffffff")
        white = self.renderer.render(size=SIZE)
        self.assertEqual(white[0, 0].tolist(), [255] * 4)
        self.assertTrue((self.renderer.render(size=SIZE, style=None, background=None) == usual).all())
        with self.assertRaises(ValueError):
            self.renderer.set(style="none")
        self.assertTrue((self.renderer.render(size=SIZE) == white).all())
        self.renderer.set(style=None, background=None)
        self.assertTrue((self.renderer.render(size=SIZE) == usual).all())

    def test_files_are_the_points_that_they_hold(self):
        points, colors = ball()
        self.renderer.add_points(points, colors)
        expected = self.renderer.render(size=SIZE)
        self.renderer.remove(self.renderer.clouds[0])
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "ball.ply")
            write_ply(path, points, colors)
            self.renderer.open(path)
            self.assertTrue((self.renderer.render(size=SIZE) == expected).all())
            camera = os.path.join(folder, "camera.json")
            with open(camera, "w") as file:
                json.dump(self.renderer.camera(size=SIZE), file)
            self.assertTrue((self.renderer.render(camera, SIZE) == expected).all())
            with open(path, "r+b") as file:
                file.truncate(100_000)
            self.renderer.remove(self.renderer.clouds[0])
            self.renderer.open([path])
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                self.renderer.render(size=SIZE)
            self.assertTrue(any("could be read" in str(one.message) for one in caught), caught)
        with self.assertRaisesRegex(pointillist.Error, "no-such.las"):
            self.renderer.open("no-such.las")

    def test_other_threads_run_while_it_draws(self):
        self.renderer.add_points(*ball(400_000))
        done, counted = threading.Event(), 0

        def draw():
            self.renderer.render(size=(1280, 720))
            self.renderer.device
            done.set()

        thread = threading.Thread(target=draw)
        thread.start()
        while not done.is_set():
            counted += 1
            time.sleep(0.001)
            # Waits for the other thread, and keeps the interpreter from none.
            if counted == 20:
                self.assertIn("Renderer", repr(self.renderer))
        thread.join()
        self.assertGreater(counted, 5)

    def test_an_interrupt_ends_it(self):
        points, colors = ball(3_000_000)
        self.renderer.add_points(points, colors)
        timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        with self.assertRaises(KeyboardInterrupt):
            for _ in range(1000):
                self.renderer.render(size=(1280, 720))
        # It draws again.
        self.assertEqual(self.renderer.render(size=SIZE).shape, (64, 96, 4))


if __name__ == "__main__":
    unittest.main()
