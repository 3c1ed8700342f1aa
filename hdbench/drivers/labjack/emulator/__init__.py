"""An emulated LabJack T4 or T7 on two TCP ports, with the simulated bench at its terminals."""
