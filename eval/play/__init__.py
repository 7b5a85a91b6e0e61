"""Play with a walking robot in a browser or in MuJoCo's window: command, push, replay and compare it."""
