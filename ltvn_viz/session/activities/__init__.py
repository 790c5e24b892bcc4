"""Activities of the app, one class each: teleop, navigation, map building, playback."""
