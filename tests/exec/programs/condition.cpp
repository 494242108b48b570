#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <mutex>
#include <thread>
#include <unistd.h>
using namespace std::chrono_literals;
std::mutex m;
std::condition_variable cv;
int lines = 0;
int main() {
    int fd = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    std::thread reader([&] {
        for (char c; read(fd, &c, 1) == 1;)
            if (c == '\n') {
                std::lock_guard<std::mutex> g(m);
                lines++;
                cv.notify_one();
            }
    });
    reader.detach();
    int timeouts = 0;
    std::thread waiter([&] {
        for (int i = 0; i < 40; i++) {
            std::unique_lock<std::mutex> l(m);
            if (cv.wait_for(l, 37ms) == std::cv_status::timeout) timeouts++;
        }
    });
    auto begin = std::chrono::steady_clock::now();
    std::thread sleeper([&] { for (int i = 0; i < 20; i++) std::this_thread::sleep_for(50ms); });
    sleeper.join();
    long ms = (std::chrono::steady_clock::now() - begin) / 1ms;
    waiter.join();
    std::printf("%ld ms, %d timeouts of 40\n", ms, timeouts);
    std::fflush(stdout);
    std::this_thread::sleep_for(60s);
}
