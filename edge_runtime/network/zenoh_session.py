"""The Zenoh session of one robot: its links, certificates and access control, in Zenoh's own names."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from edge_runtime.config.network import CarrierSettings, Robot
from edge_runtime.network.tls import ROUTER, TlsFiles, common_name

LEASE_MS: Final = 1000
"""After so long without a sign of life a link is opened anew."""
ROUTER_WAIT_MS: Final = 3000
"""How long a robot looks for its router before it is refused."""
MESSAGE_BYTES: Final = 65536
"""Greatest message that is put together from fragments: somebody else's may not fill the memory."""
_RETRY: Final = {"period_init_ms": 200, "period_max_ms": 1000}
Json = dict[str, Any]
"""A part of a Zenoh configuration, which has Zenoh's names."""


def topic(sender: object, receiver: object) -> str:
    """Return the key expression of one robot's frames to another; ``*`` stands for any robot."""
    return f"cfpg/{sender}/{receiver}"


def session_config(
    carrier: CarrierSettings, own: Robot, others: Sequence[Robot], tls: TlsFiles | None
) -> Json:
    """Return the Zenoh configuration of a robot's session.

    Declarations travel on reliable links, frames on best-effort ones: a lost frame must not hold up the
    next. Robots are peers of each other, the one with the greater id connects, or clients of the router.
    """
    config: Json = {
        "scouting": {
            "multicast": {"enabled": False},
            # Robots connect as the fleet file says: a second link to an address that gossip tells of could
            # take another way than the one that the file names.
            "gossip": {"enabled": True, "autoconnect": {"router": [], "peer": []}},
        },
        "transport": {
            "unicast": {"max_links": 4},
            "shared_memory": {"enabled": False},
            "link": {
                "tx": {
                    "lease": LEASE_MS,
                    # The control loop sends: a full queue drops at once.
                    "queue": {"congestion_control": {"drop": {"wait_before_drop": 0}}},
                },
                "rx": {"max_message_size": MESSAGE_BYTES},
            },
        },
    }
    config |= _routed(carrier.router) if carrier.router else _meshed(own, others, secure=tls is not None)
    if tls is not None:
        config["transport"]["link"]["tls"] = _certificates(tls)
        names = {ROUTER: "*"} if carrier.router else {common_name(robot.id): robot.id for robot in others}
        config["access_control"] = _access(own.id, names)
    return config


def _routed(router: str) -> Json:
    scheme, _, place = router.partition("/")
    locators = _links(place, secure=scheme == "tls")
    connect = {
        "endpoints": [{"strategy": "allOf", "locators": locators}],
        "timeout_ms": ROUTER_WAIT_MS,
        "exit_on_failure": True,
        "retry": _RETRY,
    }
    return {"mode": "client", "connect": connect}


def _meshed(own: Robot, others: Iterable[Robot], *, secure: bool) -> Json:
    places = [robot.zenoh for robot in others if robot.id < own.id and robot.zenoh]
    endpoints = [link for place in places for link in _links(place, secure=secure)]
    return {
        "mode": "peer",
        "listen": {"endpoints": _links(own.zenoh or "", secure=secure)},
        "connect": {"endpoints": endpoints, "timeout_ms": -1, "exit_on_failure": False, "retry": _RETRY},
    }


def _links(place: str, *, secure: bool) -> list[str]:
    reliable, best_effort = ("tls", "quic") if secure else ("tcp", "udp")
    return [f"{reliable}/{place}?rel=1", f"{best_effort}/{place}?rel=0"]


def _certificates(tls: TlsFiles) -> Json:
    return {
        "root_ca_certificate": str(tls.ca),
        "listen_certificate": str(tls.certificate),
        "listen_private_key": str(tls.private_key),
        "connect_certificate": str(tls.certificate),
        "connect_private_key": str(tls.private_key),
        "enable_mtls": True,
        "verify_name_on_connect": False,  # access is by common name, not by address
    }


def _access(own: int, names: Mapping[str, object]) -> Json:
    """Whoever proves a name may publish and listen as that robot ("*": as any); nobody else may."""
    rules = [_rule("outward", "egress", ["put", "declare_subscriber"], topic("*", "*"))]
    policies = [{"rules": ["outward"], "subjects": ["anybody"]}]
    for name, robot in names.items():
        puts, listens = f"{name} puts", f"{name} listens"
        rules.append(_rule(puts, "ingress", ["put"], topic(robot, own)))
        rules.append(_rule(listens, "ingress", ["declare_subscriber"], topic("*", robot)))
        policies.append({"rules": [puts, listens], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": "anybody"}, *({"id": name, "cert_common_names": [name]} for name in names)],
        "policies": policies,
    }


def _rule(name: str, flow: str, messages: list[str], topics: str) -> Json:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": [topics],
    }
