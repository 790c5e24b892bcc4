"""The predictor of a map goes on with it; elsewhere the better one for the camera is taken, and it is said why."""

from dataclasses import replace

import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import OptionError
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.predictors.opening import open_predictor, predictor_names
from ltvn_core.robots.robot_spec import LOCOBOT

KINECT = CameraModel.from_fov(640, 480, 1.0, height_m=0.5)
SIMULATED = ImageSource(camera=LOCOBOT.camera, config={"verb": "collect"})


def test_our_predictors_come_first_in_every_list() -> None:
    assert predictor_names()[:3] == ("network", "geometric", "oracle")


def test_images_of_the_simulator_are_for_the_network_and_those_of_other_cameras_for_geometry() -> None:
    assert SIMULATED.choose().name == "network"
    assert str(ImageSource(camera=KINECT).choose()) == "geometric (the camera, 640 x 480, is not the simulator's)"
    assert ImageSource(camera=replace(LOCOBOT.camera, height_m=0.3)).choose().name == "network"


def test_an_imported_drive_is_real_whatever_its_camera_is() -> None:
    imported = ImageSource(camera=LOCOBOT.camera, config={"verb": "import"})
    assert str(imported.choose()) == "geometric (the drive was imported)"


def test_a_map_is_gone_on_with_by_the_predictor_that_made_it() -> None:
    made = ImageSource(camera=KINECT, config={"predictor": "oracle"}, fingerprint="oracle")
    assert str(made.choose()) == "oracle (the map was built with it)"
    assert made.choose_anew().name == "geometric"
    assert str(made.choose("network")) == "network (as asked)"


def test_maps_of_earlier_versions_were_made_by_the_network_or_the_oracle() -> None:
    assert replace(SIMULATED, fingerprint="0520819c6af2").choose().name == "network"
    assert replace(SIMULATED, fingerprint="oracle").choose().name == "oracle"


def test_a_predictor_that_is_not_installed_is_refused_with_those_that_are() -> None:
    with pytest.raises(OptionError, match=r"'clairvoyant'; installed are: network, geometric, oracle"):
        SIMULATED.choose("clairvoyant")
    with pytest.raises(OptionError, match="Install the package"):
        replace(SIMULATED, config={"predictor": "clairvoyant"}).choose()


def test_a_predictor_takes_the_camera_it_is_opened_for_at_no_more_than_320_by_240() -> None:
    assert open_predictor("geometric", camera=KINECT).camera == KINECT.scaled(320, 240)
    small = replace(KINECT.scaled(160, 120), depth_scale=0.001)
    assert open_predictor("geometric", camera=small).camera == replace(small, depth_scale=1.0)
