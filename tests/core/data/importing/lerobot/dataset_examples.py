"""Small data sets in LeRobot's versions 2.1 and 3, written by pyarrow and PyAV."""

import json
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

FPS = 10
WIDTH, HEIGHT = 64, 48
FRONT, DEPTH = "observation.images.front", "observation.images.front_depth"
STATE = "observation.state"


def colours(number: int) -> NDArray[np.uint8]:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([rows * 4, columns * 3, np.full_like(rows, 12 * number)], axis=-1).astype(np.uint8)


def poses(count: int) -> NDArray[np.float32]:
    steps = np.arange(count)
    return np.stack([0.1 * steps, 0.02 * steps, 0.05 * steps], axis=1).astype(np.float32)


def log_codes(metres: NDArray[np.float32]) -> NDArray[np.uint16]:
    """LeRobot's own quantisation with its usual constants: 0.01 to 10 m, shifted by 3.5 m."""
    low, high = np.log(0.01 + 3.5), np.log(10.0 + 3.5)
    return np.rint((np.log(metres + 3.5) - low) / (high - low) * 4095).clip(0, 4095).astype(np.uint16)


def write_video(path: Path, images: Sequence[NDArray], *, codec: str, pix_fmt: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", format="mp4") as container:
        stream: Any = container.add_stream(codec, rate=FPS, options={"crf": "10"} if codec == "libx264" else {})
        stream.width, stream.height, stream.pix_fmt = images[0].shape[1], images[0].shape[0], pix_fmt
        stream.time_base = Fraction(1, FPS)
        for number, image in enumerate(images):
            frame: Any = av.VideoFrame.from_ndarray(image, "rgb24" if image.ndim == 3 else pix_fmt)
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def write_table(path: Path, columns: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), path)


def write_dataset(
    folder: Path,
    lengths: Sequence[int] = (6,),
    *,
    as_video: bool = True,
    depth: bool = False,
    info: dict[str, Any] | None = None,
) -> Path:
    """Write episodes one behind the other into one data file and one video, as LeRobot does."""
    count = sum(lengths)
    places = [(episode, step) for episode, length in enumerate(lengths) for step in range(length)]
    state = np.concatenate([poses(length) for length in lengths])
    kind = "video" if as_video else "image"
    features: dict[str, Any] = {
        FRONT: {"dtype": kind, "shape": [HEIGHT, WIDTH, 3], "names": ["height", "width", "channels"]},
        STATE: {"dtype": "float32", "shape": [3], "names": ["x.pos", "y.pos", "theta.pos"]},
    }
    columns: dict[str, Any] = {
        "timestamp": pa.array([step / FPS for _, step in places], pa.float32()),
        "frame_index": [step for _, step in places],
        "episode_index": [episode for episode, _ in places],
        STATE: pa.array(state.tolist(), pa.list_(pa.float32(), 3)),
    }
    metres = [np.full((HEIGHT, WIDTH), 1 + 0.25 * number, np.float32) for number in range(count)]
    if as_video:
        video = folder / "videos" / FRONT / "chunk-000/file-000.mp4"
        write_video(video, [colours(n) for n in range(count)], codec="libx264", pix_fmt="yuv420p")
    else:
        pictures = [cv2.imencode(".png", colours(n)[..., ::-1])[1].tobytes() for n in range(count)]
        columns[FRONT] = [{"bytes": picture, "path": None} for picture in pictures]
    if depth:
        features[DEPTH] = {"dtype": kind, "shape": [HEIGHT, WIDTH, 1], "info": {"is_depth_map": True}}
        if as_video:
            video = folder / "videos" / DEPTH / "chunk-000/file-000.mp4"
            write_video(video, [log_codes(each) for each in metres], codec="ffv1", pix_fmt="gray12le")
        else:
            pictures = [cv2.imencode(".png", (each * 1000).astype(np.uint16))[1].tobytes() for each in metres]
            columns[DEPTH] = [{"bytes": picture, "path": None} for picture in pictures]
    write_table(folder / "data/chunk-000/file-000.parquet", columns)
    write_episodes(folder, lengths)
    said = {"codebase_version": "v3.0", "fps": FPS, "total_frames": count, "features": features, **(info or {})}
    (folder / "meta/info.json").write_text(json.dumps(said), encoding="utf-8")
    return folder


def write_dataset_v2(folder: Path, lengths: Sequence[int] = (6,), *, as_video: bool = True, **changed: Any) -> Path:
    """Write a data set of version 2.1: a table and a video for each episode."""
    kind = "video" if as_video else "image"
    for episode, length in enumerate(lengths):
        name = f"chunk-{episode // 2:03d}/episode_{episode:06d}"
        images = [colours(episode + step) for step in range(length)]
        columns: dict[str, Any] = {
            "timestamp": pa.array([step / FPS for step in range(length)], pa.float32()),
            "episode_index": [episode] * length,
            STATE: pa.array(poses(length).tolist(), pa.list_(pa.float32(), 3)),
        }
        if as_video:
            video = folder / f"videos/chunk-{episode // 2:03d}/{FRONT}/episode_{episode:06d}.mp4"
            write_video(video, images, codec="libx264", pix_fmt="yuv420p")
        else:
            pictures = [cv2.imencode(".png", image[..., ::-1])[1].tobytes() for image in images]
            columns[FRONT] = [{"bytes": picture, "path": None} for picture in pictures]
        write_table(folder / f"data/{name}.parquet", columns)
    features = {
        FRONT: {"dtype": kind, "shape": [HEIGHT, WIDTH, 3], "info": {"video.is_depth_map": False}},
        STATE: {"dtype": "float32", "shape": [3], "names": {"axes": ["x", "y", "yaw"]}},
    }
    said = {"codebase_version": "v2.1", "fps": FPS, "chunks_size": 2, "features": features, **changed}
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "meta/info.json").write_text(json.dumps(said), encoding="utf-8")
    lines = [json.dumps({"episode_index": n, "tasks": ["drive"], "length": k}) for n, k in enumerate(lengths)]
    (folder / "meta/episodes.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def write_episodes(folder: Path, lengths: Sequence[int], **changed: Any) -> None:
    starts = np.concatenate([[0], np.cumsum(lengths)])
    columns: dict[str, Any] = {
        "episode_index": list(range(len(lengths))),
        "length": list(lengths),
        "data/chunk_index": [0] * len(lengths),
        "data/file_index": [0] * len(lengths),
    }
    for key in (FRONT, DEPTH):
        columns[f"videos/{key}/chunk_index"] = [0] * len(lengths)
        columns[f"videos/{key}/file_index"] = [0] * len(lengths)
        columns[f"videos/{key}/from_timestamp"] = (starts[:-1] / FPS).tolist()
        columns[f"videos/{key}/to_timestamp"] = (starts[1:] / FPS).tolist()
    write_table(folder / "meta/episodes/chunk-000/file-000.parquet", {**columns, **changed})
