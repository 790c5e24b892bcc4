"""What the app can be doing, one class each: teleop, navigation, map building, playback."""
