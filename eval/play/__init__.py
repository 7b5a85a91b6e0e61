"""Play with a robot that walks or stands, in a browser or in MuJoCo's window: command, push, replay."""
