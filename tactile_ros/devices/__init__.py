"""Bytes: transports, codecs and the simulated twins that speak them.

packets -> framing -> serial_board (over transport) is the road of the ReSkin / AnySkin board;
simulated and player are its twin, damage says what the format cannot show.
"""
