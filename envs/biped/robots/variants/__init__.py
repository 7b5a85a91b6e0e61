"""The biped built differently: what a robot may differ in and still walk with the same control."""
