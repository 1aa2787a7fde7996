"""Bytes: transports, codecs and the simulated twins that speak them.

packets -> framing -> serial_board (over transport) is the road of the ReSkin / AnySkin board;
simulated and player are its twin, damage says what the format cannot show.
framed_payloads -> framed_readings -> framed -> framed_decoder -> framed_board is that of our own
framed protocol, device_time its clock. reconnecting is the port of both; serial_twin is what their
twins board_twin and framed_twin share.
mlx90393 -> chip (through mux) -> chip_care -> chip_array is the road of chips on I2C buses, with
reading_watch over what they say; simulated_chip -> simulated_i2c -> chip_array_twin is its twin.
"""
