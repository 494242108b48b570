// A client in C#: a thread that listens, another one that makes garbage, collections in between.
using System;
using System.IO.Ports;
using System.Threading;

class Client
{
    static void Main(string[] words)
    {
        var port = new SerialPort(words[0], 9600);
        port.NewLine = "\r\n";
        port.Open();
        var garbage = new Thread(() => {
            while (true) { var some = new byte[1000]; Thread.Sleep(20); }
        });
        garbage.IsBackground = true;
        garbage.Start();
        var ear = new Thread(() => { while (true) Console.WriteLine(port.ReadLine()); });
        ear.IsBackground = true;
        ear.Start();
        int count = 0;
        for (; count < 5; count++)
        {
            Thread.Sleep(500);
            GC.Collect();
            if (count == 1) port.Write("ping\r\n");
        }
        Console.WriteLine("collected " + count + " times");
    }
}
