import asyncio

from alicat import FlowController

from common import port, run

loop = asyncio.new_event_loop()


async def opened():
    flow = FlowController("/dev/.." + port())
    await flow.set_flow_rate(3.5)
    return flow


flow = loop.run_until_complete(opened())
run(flow, {
    "flow": lambda flow: loop.run_until_complete(flow.get()),
    "firmware": lambda flow: loop.run_until_complete(flow.get_firmware()),
}, (OSError, ValueError))
