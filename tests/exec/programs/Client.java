// A thread reads lines, another one takes them from a queue with a time limit, and asks.
import java.io.*;
import java.util.concurrent.*;

public class Client {
    public static void main(String[] args) throws Exception {
        var path = System.getenv("HILRIG_PORT_SONAR");
        var in = new BufferedReader(new InputStreamReader(new FileInputStream(path)));
        var out = new FileOutputStream(path);
        var lines = new LinkedBlockingQueue<String>();
        var reader = new Thread(() -> {
            try {
                for (String line; (line = in.readLine()) != null; ) lines.put(line);
            } catch (Exception error) {
                throw new RuntimeException(error);
            }
        });
        reader.setDaemon(true);
        reader.start();
        long begin = System.nanoTime();
        while (true) {
            var line = lines.poll(30, TimeUnit.MILLISECONDS);
            if (line == null) continue;
            System.out.println((System.nanoTime() - begin) / 1000 + " us " + line);
            if (line.startsWith("mm")) out.write("ping\r\n".getBytes());
        }
    }
}
