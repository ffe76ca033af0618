"""A guest in Zenoh that is not ours (eclipse-zenoh of PyPI): what it finds at HOST:PORT, as JSON."""

import json
import sys
import time

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps(["tcp/" + sys.argv[1]]))
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config) as session:
    heard = []
    subscriber = session.declare_subscriber("lrfslam/*/status", lambda sample: heard.append(sample.payload.to_string()))

    def answers(key):
        return [(str(reply.ok.key_expr), reply.ok.payload.to_bytes()) for reply in session.get(key) if reply.ok]

    alive = [str(reply.ok.key_expr) for reply in session.liveliness().get("lrfslam/*") if reply.ok]
    changes = answers("lrfslam/*/changes?0-0")
    status = answers("lrfslam/*/status")
    wrong = [reply.err.payload.to_string() for reply in session.get("lrfslam/*/changes?all") if reply.err]
    began = time.time()
    while len(heard) < 2 and time.time() < began + 20:
        time.sleep(0.05)
    print(json.dumps({
        "alive": alive,
        "changes": [[key, len(state), state[:4].hex()] for key, state in changes],
        "status": [[key, json.loads(state)] for key, state in status],
        "wrong": wrong,
        "heard": [json.loads(state) for state in heard],
    }))
