// A goroutine reads lines, another one asks at the pace of a ticker.
package main

import (
	"bufio"
	"fmt"
	"os"
	"time"
)

func main() {
	port, err := os.OpenFile(os.Getenv("HILRIG_PORT_SONAR"), os.O_RDWR, 0)
	if err != nil {
		panic(err)
	}
	lines := make(chan string)
	go func() {
		for scanner := bufio.NewScanner(port); scanner.Scan(); {
			lines <- scanner.Text()
		}
	}()
	begin := time.Now()
	ticker := time.NewTicker(130 * time.Millisecond)
	for {
		select {
		case line := <-lines:
			fmt.Println(time.Since(begin), line)
		case <-ticker.C:
			fmt.Fprint(port, "ping\r\n")
		}
	}
}
