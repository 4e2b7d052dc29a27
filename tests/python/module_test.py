# SPDX-License-Identifier: Apache-2.0
"""The Python module on bundled renders, and every example of docs/python.md. Usage: module_test.py SOURCE"""
import os
import pathlib
import re
import signal
import sys
import tempfile
import threading
import time
import unittest

import numpy as np

import rayloom

SOURCE = pathlib.Path(sys.argv.pop(1))
SCENE = SOURCE / "tests/data/cycles/interior"
STACK = f"{SCENE}/stack/s%02d.exr@1-8"

GAIN = """
rayloom: 1
name: gain
params:
  value: {type: float, default: 2, min: 0}
inputs:
  color: {doc: a render}
nodes:
  bright: {op: oiio.mul, image: color, value: $value}
outputs:
  image: bright
"""


class Images(unittest.TestCase):
    def test_arrays_and_back(self):
        array = np.arange(2 * 3 * 4, dtype=np.float32).reshape(2, 3, 4)
        image = rayloom.Image(array, data_window=(-5, 7, 3, 2))
        self.assertEqual(image.channels, ["R", "G", "B", "A"])
        self.assertEqual(image.data_window, (-5, 7, 3, 2))
        np.testing.assert_array_equal(image.pixels, array)
        np.testing.assert_array_equal(image["B"], array[:, :, 2])
        np.testing.assert_array_equal(np.asarray(image), array)
        image.pixels[1, 2, 3] = 9
        self.assertEqual(image["A"][1, 2], 9, "arrays share the image's memory")

    def test_any_layout_of_numbers(self):
        whole = np.random.default_rng(1).random((6, 10, 3))
        for array in (whole, whole[::2, ::-1], np.asfortranarray(whole), whole.astype(np.float16), whole[:, :, 0]):
            got = rayloom.Image(array).pixels
            np.testing.assert_array_equal(got.reshape(array.shape), array.astype(np.float32))

    def test_pixels_outlive_the_image(self):
        pixels = rayloom.Image(np.ones((4, 4, 3))).pixels
        self.assertEqual(pixels.sum(), 48)

    def test_wrong_arrays_are_explained(self):
        for array, word in ((np.ones(3), "1 dimensions"), (np.ones((2, 2, 5)), "channels="), (np.ones((0, 2)), "empty")):
            with self.assertRaisesRegex(rayloom.UsageError, word):
                rayloom.Image(array)
        with self.assertRaisesRegex(KeyError, "'R', 'G' and 'B'"):
            rayloom.Image(np.ones((2, 2, 3)))["Z"]

    def test_read_and_compare(self):
        reference = rayloom.read(SCENE / "ref.exr")
        self.assertEqual(reference.channels[:3], ["R", "G", "B"])
        errors = rayloom.compare(SCENE / "noisy_16.exr", reference)
        self.assertGreater(errors["relmse"], 0.1)
        self.assertEqual(rayloom.compare(reference, reference)["rmse"], 0)


class Graphs(unittest.TestCase):
    def test_says_what_it_takes(self):
        graph = rayloom.Graph("ray-histogram-fusion-stack")
        self.assertEqual(graph.inputs["stack"]["kind"], "list")
        self.assertEqual(graph.params["window"]["type"], "int")
        self.assertEqual(graph["window"], 13)
        graph["window"] = 9
        self.assertEqual(graph["window"], 9)
        with self.assertRaisesRegex(rayloom.UsageError, "did you mean 'window'"):
            graph["windw"] = 3
        with self.assertRaisesRegex(rayloom.UsageError, "window"):
            graph["window"] = "wide"

    def test_denoises_files(self):
        result = rayloom.Graph("ray-histogram-fusion-stack").run({"stack": STACK}, scales=1)
        image = result["image"]
        noisy = np.mean([rayloom.read(f"{SCENE}/stack/s{k:02d}.exr").pixels for k in range(1, 9)], axis=0)
        self.assertEqual(image.pixels.shape, noisy.shape)
        self.assertLess(rayloom.compare(image, SCENE / "ref.exr")["relmse"],
                        0.2 * rayloom.compare(noisy, SCENE / "ref.exr")["relmse"])
        self.assertGreater(result.seconds, 0)
        self.assertEqual({node["id"] for node in result.stats["nodes"]} & {"fused"}, {"fused"})

    def test_files_and_arrays_give_the_same_pixels(self):
        graph = rayloom.Graph("ray-histogram-fusion-stack")
        by_files = graph.run({"stack": STACK})["image"]
        images = [rayloom.read(f"{SCENE}/stack/s{k:02d}.exr") for k in range(1, 9)]
        for stack in (images, [i.pixels for i in images]):
            np.testing.assert_array_equal(graph.run({"stack": stack}, threads=1)["image"].pixels, by_files.pixels)

    def test_parameters_roi_and_written_files(self):
        graph = rayloom.Graph.from_text(GAIN)
        array = np.random.default_rng(2).random((40, 30, 3)).astype(np.float32)
        np.testing.assert_array_equal(graph.run({"color": array})["image"].pixels, array * np.float32(2))
        graph["value"] = 3
        part = graph.run({"color": array}, roi=(4, 5, 6, 7))["image"]
        self.assertEqual(part.data_window, (4, 5, 6, 7))
        np.testing.assert_array_equal(part.pixels, array[5:12, 4:10] * np.float32(3))
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "out.%04d.exr"
            result = graph.run({"color": array}, {"image": path}, frame=7, value=1, type="float")
            self.assertEqual(result.written, [f"{folder}/out.0007.exr"])
            self.assertNotIn("image", result)
            np.testing.assert_array_equal(rayloom.read(result.written[0]).pixels, array)

    def test_errors_have_kinds(self):
        graph = rayloom.Graph.from_text(GAIN)
        for inputs, kind, word in (({"color": "nowhere.exr"}, rayloom.InputError, "nowhere.exr"),
                                   ({"colour": np.ones((2, 2, 3))}, rayloom.UsageError, "color"),
                                   ({"color": object()}, rayloom.UsageError, "color")):
            with self.assertRaisesRegex(kind, word):
                graph.run(inputs)
        with self.assertRaises(rayloom.BudgetError):
            graph.run({"color": np.ones((500, 500, 3))}, memory=1000)
        with self.assertRaisesRegex(rayloom.GraphError, "oiio.mull"):
            rayloom.Graph.from_text(GAIN.replace("oiio.mul", "oiio.mull")).run({"color": np.ones((2, 2, 3))})
        self.assertTrue(issubclass(rayloom.InputError, rayloom.Error))

    def test_progress_and_what_it_throws(self):
        graph = rayloom.Graph("ray-histogram-fusion-stack")
        shares = []
        graph.run({"stack": STACK}, progress=shares.append)
        self.assertEqual(shares[-1], 1.0)
        self.assertEqual(shares, sorted(shares))
        with self.assertRaises(ZeroDivisionError):
            graph.run({"stack": STACK}, progress=lambda share: 1 / 0)

    def test_interrupt_stops_a_long_run(self):
        graph = rayloom.Graph("ray-histogram-fusion-stack")
        stack = [np.random.default_rng(k).random((700, 700, 3)).astype(np.float32) for k in range(4)]
        begun = threading.Event()

        def interrupt():
            begun.wait()
            os.kill(os.getpid(), signal.SIGINT)

        threading.Thread(target=interrupt).start()
        start = time.monotonic()
        try:
            with self.assertRaises(KeyboardInterrupt):
                graph.run({"stack": stack}, window=101, threads=1, progress=lambda share: begun.set())
        finally:
            begun.set()
        self.assertLess(time.monotonic() - start, 30)

    def test_nodes_are_listed(self):
        self.assertIn("fuse.histogram", rayloom.nodes())


class Page(unittest.TestCase):
    def test_examples_run(self):
        blocks = re.findall(r"```python\n(.*?)```", (SOURCE / "docs/python.md").read_text(), re.S)
        self.assertGreaterEqual(len(blocks), 3)
        before = os.getcwd()
        with tempfile.TemporaryDirectory() as folder:
            for name in ("stack", "ref.exr", "noisy_16.exr"):
                (pathlib.Path(folder) / name).symlink_to(SCENE / name)
            os.chdir(folder)
            try:
                names = {}
                for block in blocks:
                    exec(compile(block, "docs/python.md", "exec"), names)
            finally:
                os.chdir(before)


if __name__ == "__main__":
    unittest.main()
