"""A client of Foxglove's WebSocket protocol (subprotocol foxglove.sdk.v1): draws the room and drives
to its waypoint, as the Foxglove app does. Messages are decoded by the schemas that the server sends.

usage: foxglove_live.py PORT
"""

import asyncio
import json
import struct
import sys
import time

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.asyncio.client import connect

from room import Room, heading_of
from messages import take

import base64


def kind_of(channel):
    """The class of a channel's messages, from its schema."""
    assert channel["encoding"] == "protobuf", channel
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for one in files.file:
        pool.Add(one)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))


async def follow(port):
    room, until = Room(), time.monotonic() + 60
    while True:
        try:
            socket = await connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"])
            break
        except OSError:
            assert time.monotonic() < until, "no server"
            await asyncio.sleep(0.1)
    async with socket:
        topics, subscribed = {}, set()
        advert = {"id": 1, "topic": "/cmd_vel", "encoding": "json", "schemaName": "Twist"}
        await socket.send(json.dumps({"op": "advertise", "channels": [advert]}))
        told = 0.0
        while time.monotonic() < until and not (room.is_there() and len(room.scans) > 30):
            if time.monotonic() - told > 0.05:
                told = time.monotonic()
                twist = {"linear": {"x": room.speed()}, "angular": {"z": 0.0}}
                await socket.send(b"\1" + struct.pack("<I", 1) + json.dumps(twist).encode())
            frame = await asyncio.wait_for(socket.recv(), 10)
            if isinstance(frame, str):
                message = json.loads(frame)
                if message["op"] == "advertise":
                    for one in message["channels"]:
                        topics[one["id"]] = (one["topic"], kind_of(one))
                        wanted = {"id": one["id"], "channelId": one["id"]}
                        subscribed.add(one["topic"])
                        await socket.send(json.dumps({"op": "subscribe", "subscriptions": [wanted]}))
            elif frame[0] == 1:
                number, at_ns = struct.unpack_from("<IQ", frame, 1)
                topic, kind = topics[number]
                take(room, topic, kind.FromString(frame[13:]))
            elif frame[0] == 2:
                room.clock(struct.unpack_from("<Q", frame, 1)[0] / 1e9)
    assert subscribed == {"/scan", "/tf", "/odom"}, subscribed
    return room


asyncio.run(follow(int(sys.argv[1]))).judge()
