// A client by Asio: prints lines, sends "ping" when a timer expires.
#include <asio.hpp>
#include <functional>
#include <iostream>

int main(int, char **words)
{
    asio::io_context context;
    asio::serial_port port(context, words[1]);
    port.set_option(asio::serial_port::baud_rate(9600));
    asio::streambuf heard;
    int lines = 0;
    std::function<void()> listen = [&] {
        asio::async_read_until(port, heard, '\n', [&](asio::error_code error, std::size_t) {
            std::string line;
            std::getline(std::istream(&heard), line);
            std::cout << line << std::endl;
            if (!error && ++lines < 30) listen();
        });
    };
    asio::steady_timer timer(context, std::chrono::seconds(1));
    timer.async_wait([&](asio::error_code) { asio::write(port, asio::buffer("ping\r\n", 6)); });
    listen();
    context.run();
    return 0;
}
