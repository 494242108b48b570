// A client on the vendor's SDK for C++. Each turn is a line of JSON, as those of clients.py.
//
// usage: vendor_sdk PORT SECONDS [mode=N]     mode: the number of a scan mode, or the typical one
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "sl_lidar.h"
#include "sl_lidar_driver.h"

using Clock = std::chrono::steady_clock;

static int fail(const char *what) {
    std::fprintf(stderr, "%s\n", what);
    return 1;
}

int main(int argc, char **argv) {
    if (argc < 3)
        return fail("usage: vendor_sdk PORT SECONDS [mode=N]");
    auto channel = sl::createSerialPortChannel(argv[1], 115200);
    auto driver = sl::createLidarDriver();
    if (SL_IS_FAIL((*driver)->connect(*channel)))
        return fail("connect failed");
    sl_lidar_response_device_info_t info;
    sl_lidar_response_device_health_t health;
    if (SL_IS_FAIL((*driver)->getDeviceInfo(info)) || SL_IS_FAIL((*driver)->getHealth(health)))
        return fail("no info or no health");
    std::vector<sl::LidarScanMode> modes;
    if (SL_IS_FAIL((*driver)->getAllSupportedScanModes(modes)))
        return fail("no scan modes");
    std::fprintf(stderr, "firmware %x, health %d, %zu modes\n", info.firmware_version,
                 health.status, modes.size());
    (*driver)->setMotorSpeed();
    sl_u16 mode = 0;
    sl::LidarScanMode used;
    bool is_chosen = argc > 3 && std::strncmp(argv[3], "mode=", 5) == 0;
    if (is_chosen)
        mode = static_cast<sl_u16>(std::atoi(argv[3] + 5));
    else if (SL_IS_FAIL((*driver)->getTypicalScanMode(mode)))
        return fail("no typical mode");
    if (SL_IS_FAIL((*driver)->startScanExpress(false, mode, 0, &used)))
        return fail("the scan does not start");
    std::fprintf(stderr, "mode %s\n", used.scan_mode);
    auto until = Clock::now() + std::chrono::duration<double>(std::atof(argv[2]));
    static sl_lidar_response_measurement_node_hq_t nodes[8192];
    while (Clock::now() < until) {
        size_t count = sizeof nodes / sizeof *nodes;
        if (SL_IS_FAIL((*driver)->grabScanDataHq(nodes, count))) {
            std::fprintf(stderr, "passed over: no scan\n");
            continue;
        }
        std::printf("{\"turn\": [");
        for (size_t n = 0; n < count; n++)
            std::printf("%s[%.3f, %.2f]", n ? ", " : "", nodes[n].angle_z_q14 * 90.0 / 16384.0,
                        nodes[n].dist_mm_q2 / 4.0);
        std::printf("]}\n");
        std::fflush(stdout);
    }
    (*driver)->stop();
    (*driver)->setMotorSpeed(0);
    delete *driver;
    return 0;
}
