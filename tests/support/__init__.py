"""Scenes, fakes and harnesses that several tests share."""
