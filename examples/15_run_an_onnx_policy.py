"""Build a map with a policy from an ONNX file and a card that says what goes in and what comes out.

`python examples/15_run_an_onnx_policy.py FOLDER` writes model, card and map into a new folder. The model is a stand-in
that counts the pixels that differ; docs/how-to/own-policy.md shows how to export a real one.
"""

import sys
from pathlib import Path

import onnx
import onnx.parser

import ltvn_core as ltvn

DEMO = Path(__file__).parents[1] / "recordings" / "demo-drive.rrd"
IMAGES = 80
MODEL = """
<ir_version: 9, opset_import: ["" : 18]>
policy (float[N, 3, 36, 48] source, float[N, 3, 36, 48] target) => (float[N, 1] steps, float[N, 1, 2] way) {
    difference = Sub (source, target)
    absolute = Abs (difference)
    pixels = Constant <value_ints = [1, 2, 3]> ()
    mean = ReduceMean <keepdims = 0> (absolute, pixels)
    fifty = Constant <value_float = 50.0> ()
    scaled = Mul (mean, fifty)
    one = Constant <value_ints = [1]> ()
    steps = Unsqueeze (scaled, one)
    aside = Sub (steps, steps)
    ahead = Concat <axis = 1> (steps, aside)
    way = Unsqueeze (ahead, one)
}
"""
CARD = """
model = "policy.onnx"
image.size = [48, 36]
inputs = {source = "source", target = "target"}
outputs = {distance = "steps", waypoints = "way"}
units = {reachable_below = 6.0, distance_m = 0.1}
"""


def main(folder: Path) -> None:
    """Write the model and its card, and build a map of the demo drive with them."""
    folder.mkdir(parents=True, exist_ok=True)
    onnx.save(onnx.parser.parse_model(MODEL), str(folder / "policy.onnx"))
    (folder / "card.toml").write_text(CARD, encoding="utf-8")
    policy = ltvn.open_predictor("onnx", weights=folder / "card.toml")
    recording = ltvn.Recording.open(DEMO)
    images = [recording.observation(frame) for frame in recording.frames[:IMAGES]]
    made = ltvn.build_map(images, predictor=policy, predictor_name="onnx", camera=recording.meta.camera)
    made.save(folder / "map.rrd")
    print(f"{IMAGES} images became {len(made.graph.nodes)} nodes and {len(made.graph.edges)} edges")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
