// The core on a board: a clock, a serial line and four lights. The program is loaded over the line, so one bitstream serves
// every program that fits its parameters. The top of a board (hw_model/rtl/boards/top.sv.in) connects the pins to it.
module top_uart #(
    parameter integer CLOCK = 12000000,  // Hz
    parameter integer BAUD = 1000000,    // bits per second; CLOCK is at least 8 times as much
    // The sizes of the core, from here to GROUPS: locsnn_core.sv says what they are.
    parameter integer AXONS = 2048,
    parameter integer SYNAPSES = 16384,
    parameter integer COMPARTMENTS = 512,
    parameter integer SLOTS = 16,
    parameter integer CHARGE = 18,
    parameter integer JOIN = 26,
    parameter integer BITMAP = 1024,
    parameter integer VISITS = 128,
    parameter integer ENTRIES = 128,
    parameter integer WORD = 32,
    parameter integer PHASE_WORDS = 512,
    parameter integer ONE_PORT = 0,
    parameter integer LATER = 0,
    parameter integer GROUPS = 0,
    parameter integer BUFFER = 256,      // bytes of frames that wait; a power of two, and at least 64
    parameter integer SPIKES = 256       // spikes that wait for the host; a power of two
) (
    input  logic       clk,
    input  logic       button,  // high: reset, as a button or a PLL without lock asks for it; 0 where there is neither
    input  logic       rx,      // from the host
    output logic       tx,      // to the host
    // From bit 0: a program is loaded; a recording runs; toggles with every answer; an error since the reset. High: on.
    output logic [3:0] leds
);
    localparam integer BIT = (CLOCK + BAUD / 2) / BAUD;  // cycles per bit, rounded

    wire       reset, in_valid, in_broken, out_valid, out_ready, loaded, running, answered, failed;
    wire [7:0] in_data, out_data;
    reset_sync start (.clk, .button, .reset);
    uart_rx #(.BIT(BIT)) receiver (.clk, .reset, .rx, .valid(in_valid), .data(in_data), .broken(in_broken));
    uart_tx #(.BIT(BIT)) transmitter (.clk, .reset, .valid(out_valid), .ready(out_ready), .data(out_data), .tx);
    locsnn_bytes #(
        .AXONS(AXONS), .SYNAPSES(SYNAPSES), .COMPARTMENTS(COMPARTMENTS), .SLOTS(SLOTS), .CHARGE(CHARGE), .JOIN(JOIN), .BITMAP(BITMAP),
        .VISITS(VISITS), .ENTRIES(ENTRIES), .WORD(WORD), .PHASE_WORDS(PHASE_WORDS), .ONE_PORT(ONE_PORT), .LATER(LATER), .GROUPS(GROUPS),
        .BUFFER(BUFFER), .SPIKES(SPIKES)
    ) bytes (
        .clk, .reset, .in_valid, .in_data, .in_broken, .out_valid, .out_ready, .out_data,
        .loaded, .running, .answered, .failed
    );

    logic odd, wrong;
    assign leds = {wrong, odd, running, loaded};
    always_ff @(posedge clk) begin
        if (answered) odd <= !odd;
        if (failed) wrong <= 1;
        if (reset) {odd, wrong} <= 0;
    end
endmodule
