"""Drivers for makes of device, each behind the registry like one of another package."""
