"""A stand-in for the command ``ip``, and what it prints about CAN interfaces."""

CAN = (
    '[{"ifindex":3,"ifname":"can0","flags":["NOARP","UP","LOWER_UP","ECHO"],"mtu":16,"qdisc":"pfifo_fast",'
    '"operstate":"UP","linkmode":"DEFAULT","group":"default","txqlen":10,"link_type":"can","promiscuity":0,'
    '"min_mtu":0,"max_mtu":0,"linkinfo":{"info_kind":"can","info_data":{"ctrlmode":["BERR-REPORTING"],'
    '"state":"ERROR-ACTIVE","berr_counter":{"tx":0,"rx":0},"restart_ms":100,"bittiming":{"bitrate":500000,'
    '"sample_point":"0.875","tq":125,"prop_seg":6,"phase_seg1":7,"phase_seg2":2,"sjw":1,"brp":1},'
    '"bittiming_const":{"name":"sja1000","tseg1":{"min":1,"max":16},"tseg2":{"min":1,"max":8}},'
    '"clock":8000000}},"num_tx_queues":1,"num_rx_queues":1}]'
)
"""Of a controller with settable bit timing, in the form of iproute2's sources."""
SERIAL = (
    '[{"ifindex":2,"ifname":"can0","flags":["NOARP","UP","LOWER_UP"],"mtu":16,"qdisc":"pfifo_fast",'
    '"operstate":"UP","linkmode":"DEFAULT","group":"default","txqlen":10,"link_type":"can","promiscuity":0,'
    '"allmulti":0,"min_mtu":0,"max_mtu":0,"linkinfo":{"info_kind":"can","info_data":{'
    '"ctrlmode_supported":["LISTEN-ONLY"],"state":"ERROR-ACTIVE","restart_ms":0,"bittiming_bitrate":0,'
    '"bitrate_const":[10000,20000,50000,100000,125000,250000,500000,800000,1000000],"clock":0}},'
    '"num_tx_queues":1,"gso_max_size":65536,"gso_max_segs":65535,"tso_max_size":65536}]'
)
"""Of the slcan driver, whose adapter was not given a bit rate by Linux; iproute2 6.1."""
VIRTUAL = (
    '[{"ifindex":3,"ifname":"vcan0","flags":["NOARP","UP","LOWER_UP"],"mtu":72,"qdisc":"noqueue",'
    '"operstate":"UNKNOWN","linkmode":"DEFAULT","group":"default","txqlen":1000,"link_type":"can",'
    '"promiscuity":0,"allmulti":0,"min_mtu":0,"max_mtu":0,"linkinfo":{"info_kind":"vcan"},'
    '"num_tx_queues":1,"gso_max_size":65536,"gso_max_segs":65535,"tso_max_size":65536}]'
)


def install_ip(folder, monkeypatch, output="", code=0, error=""):
    """Put the stand-in on the path, alone; returns the file of the arguments that it was given."""
    script, asked = folder / "ip", folder / "asked"
    script.write_text(f"#!/bin/sh\necho \"$@\" > {asked}\necho '{output}'\necho '{error}' >&2\nexit {code}\n")
    script.chmod(0o755)
    monkeypatch.setenv("PATH", str(folder))
    return asked
