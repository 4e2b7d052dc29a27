# SPDX-License-Identifier: Apache-2.0
"""Renders of one sample a pixel with more seeds than a scene's stack has, in the same way.

blender -b --factory-startup -t 1 -P virtual_flash_seeds.py -- SCRIPTS SCENE FOLDER SEED…

SCRIPTS holds common.py and scenes.py of the scenes; the log of renders goes beside that folder, so it should be
a copy. Writes FOLDER/sNN.exr.
"""
import os
import sys

scripts, scene, folder, *seeds = sys.argv[sys.argv.index("--") + 1:]
sys.path.insert(0, scripts)
import common  # noqa: E402
import scenes  # noqa: E402

for seed in map(int, seeds):
    sc = common.reset()
    common._next_index[0] = common._next_object[0] = 0
    common.setup_render(sc, scenes.SCENES[scene](sc))
    # Sample 0 of a pixel always lies in the pixel centre: take sample 1.
    sc.cycles.sample_offset = 1
    path = os.path.join(folder, "s%02d.exr" % seed)
    common.render(sc, path, 1, seed, "none", "16", frame=4 if scene == "dof" else None)
