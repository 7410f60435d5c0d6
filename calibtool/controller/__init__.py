"""The controller's own kinematic model: how it turns the poses of a program into joint values."""

from calibtool.controller.controller_model import ControllerModel, read_controller_model

__all__ = ["ControllerModel", "read_controller_model"]
