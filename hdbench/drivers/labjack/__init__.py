"""LabJack T4 and T7 on Ethernet: control by Modbus TCP, samples by their stream socket."""
