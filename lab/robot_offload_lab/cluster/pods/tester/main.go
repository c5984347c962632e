// Tester is the program of the pods with which the test cluster tests itself.
//
//	tester serve PORT              answers over TCP and UDP with the name of its pod and the address that asked
//	tester ask tcp|udp HOST:PORT   prints one answer; exit code 1 when there is none within two seconds
//	tester lookup NAME             prints the addresses of a name
//	tester measure HOST:PORT N MS  asks N times over UDP, one every MS milliseconds, and prints the round trips
package main

import (
	"context"
	"fmt"
	"log"
	"net"
	"os"
	"os/signal"
	"slices"
	"strconv"
	"strings"
	"syscall"
	"time"
)

const patience = 2 * time.Second

func main() {
	log.SetFlags(0)
	switch {
	case len(os.Args) == 3 && os.Args[1] == "serve":
		serve(os.Args[2])
	case len(os.Args) == 4 && os.Args[1] == "ask":
		ask(os.Args[2], os.Args[3])
	case len(os.Args) == 3 && os.Args[1] == "lookup":
		lookup(os.Args[2])
	case len(os.Args) == 5 && os.Args[1] == "measure":
		count, err := strconv.Atoi(os.Args[3])
		must(err)
		period, err := strconv.Atoi(os.Args[4])
		must(err)
		measure(os.Args[2], count, time.Duration(period)*time.Millisecond)
	default:
		log.Fatal("usage: tester serve PORT | ask tcp|udp HOST:PORT | lookup NAME | measure HOST:PORT N MS")
	}
}

func serve(port string) {
	name, err := os.Hostname()
	must(err)
	streams, err := net.Listen("tcp", ":"+port)
	must(err)
	packets, err := net.ListenPacket("udp", ":"+port)
	must(err)
	go func() {
		for {
			stream, err := streams.Accept()
			must(err)
			fmt.Fprintf(stream, "%s %s", name, host(stream.RemoteAddr()))
			stream.Close()
		}
	}()
	go func() {
		buffer := make([]byte, 100)
		for {
			_, from, err := packets.ReadFrom(buffer)
			must(err)
			_, _ = packets.WriteTo([]byte(name+" "+host(from)), from)
		}
	}()
	told := make(chan os.Signal, 1)
	signal.Notify(told, syscall.SIGTERM)
	<-told
}

func ask(network, address string) {
	stream, err := net.DialTimeout(network, address, patience)
	must(err)
	must(stream.SetDeadline(time.Now().Add(patience)))
	if network == "udp" {
		_, err = stream.Write([]byte("?"))
		must(err)
	}
	buffer := make([]byte, 1000)
	length, err := stream.Read(buffer)
	must(err)
	fmt.Println(string(buffer[:length]))
}

func lookup(name string) {
	limited, done := context.WithTimeout(context.Background(), patience)
	defer done()
	addresses, err := net.DefaultResolver.LookupHost(limited, name)
	must(err)
	fmt.Println(strings.Join(addresses, " "))
}

// measure prints, as JSON, the number of answers and percentiles of their round trips in microseconds.
func measure(address string, count int, period time.Duration) {
	stream, err := net.Dial("udp", address)
	must(err)
	var trips []int64
	buffer := make([]byte, 1000)
	next := time.Now()
	for range count {
		begun := time.Now()
		_, err = stream.Write([]byte("?"))
		must(err)
		must(stream.SetReadDeadline(begun.Add(patience)))
		if _, err = stream.Read(buffer); err == nil {
			trips = append(trips, time.Since(begun).Microseconds())
		}
		next = next.Add(period)
		time.Sleep(time.Until(next))
	}
	slices.Sort(trips)
	at := func(share float64) int64 {
		if len(trips) == 0 {
			return -1
		}
		return trips[int(share*float64(len(trips)-1))]
	}
	fmt.Printf("{\"answers\": %d, \"min\": %d, \"p50\": %d, \"p99\": %d, \"max\": %d}\n",
		len(trips), at(0), at(0.5), at(0.99), at(1))
}

func host(address net.Addr) string {
	name, _, err := net.SplitHostPort(address.String())
	must(err)
	return name
}

func must(err error) {
	if err != nil {
		log.Fatal(err)
	}
}
