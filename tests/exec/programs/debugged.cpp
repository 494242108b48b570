// A program for a debugger: a thread that reads, another one that counts, exceptions, containers.
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <fcntl.h>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <unistd.h>

struct Rover {
    std::mutex lock;
    std::condition_variable news;
    std::deque<std::string> lines;
    int total = 0;
    int scale = 1;
    int steered = 0;
    int faulty_at = -1;

    void understand(const std::string &line) {
        int value = std::stoi(line.substr(3));
        total += value * scale;
    }

    void steer(int port) {
        steered++;
        if (steered == faulty_at) throw std::runtime_error("no way");
        std::string text = std::to_string(total) + "\r\n";
        if (write(port, text.data(), text.size()) < 0) std::exit(3);
    }
};

int main(int count, char **words) {
    Rover rover;
    if (count > 1) rover.faulty_at = std::atoi(words[1]);
    int port = open(std::getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    std::thread reader([&] {
        std::string line;
        char byte;
        while (read(port, &byte, 1) == 1) {
            if (byte == '\r') continue;
            if (byte != '\n') {
                line += byte;
                continue;
            }
            std::lock_guard guard(rover.lock);
            rover.lines.push_back(line);
            line.clear();
            rover.news.notify_one();
        }
    });
    for (int number = 0;; number++) {
        std::unique_lock guard(rover.lock);
        rover.news.wait(guard, [&] { return !rover.lines.empty(); });
        std::string line = rover.lines.front();
        rover.lines.pop_front();
        guard.unlock();
        if (line.rfind("mm=", 0) == 0) rover.understand(line);
        if (number % 2 == 0) rover.steer(port);
    }
}
