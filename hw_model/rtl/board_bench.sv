// Test bench of a board and the serial line to it, driven by a host program: numbers come on standard input, and the bytes
// that the board sends leave on standard output, a decimal number per line. hw_model/rtl/ports.py is the host's side.
//
//     0..255      send this byte
//     256..511    send the byte that is 256 less with its stop bit low, which breaks it
//     512         wait for a byte from the board, PATIENCE cycles at most; then write a dot, after the bytes that came
//     513         press the reset button and let it go
//
// With BIT 0 there is no line: bytes pass directly to and from locsnn_bytes, one per cycle.
`timescale 1ns / 1ps
module board_bench #(
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
    parameter integer BUFFER = 1024,
    parameter integer SPIKES = 256,
    parameter integer BIT = 8,       // cycles per bit of the board
    parameter integer HOST_BIT = 8,  // and of the host
    parameter integer PATIENCE = 1 << 20
) ();
    localparam integer STDIN = 32'h8000_0000, STDOUT = 32'h8000_0001;  // file descriptors, as the language defines them

    logic       clk = 0, reset = 1, button = 0;
    logic       to_board = 1;                     // the line; 1 while it is idle
    logic       pass = 0, pass_broken = 0;        // without a line: a byte, or a broken byte, passes
    logic [7:0] passed = 0;
    wire        heard_valid;
    wire  [7:0] heard;
    generate
        if (BIT != 0) begin : over_line
            wire       from_board, broken;
            wire [3:0] leds;
            top_uart #(
                .CLOCK(BIT), .BAUD(1), .AXONS(AXONS), .SYNAPSES(SYNAPSES), .COMPARTMENTS(COMPARTMENTS), .SLOTS(SLOTS),
                .CHARGE(CHARGE), .JOIN(JOIN), .BITMAP(BITMAP), .VISITS(VISITS), .ENTRIES(ENTRIES), .WORD(WORD),
                .PHASE_WORDS(PHASE_WORDS), .ONE_PORT(ONE_PORT), .LATER(LATER), .GROUPS(GROUPS), .BUFFER(BUFFER), .SPIKES(SPIKES)
            ) board (.clk, .button, .rx(to_board), .tx(from_board), .leds);
            uart_rx #(.BIT(HOST_BIT)) listener (.clk, .reset, .rx(from_board), .valid(heard_valid), .data(heard), .broken);
        end else begin : directly
            wire loaded, running, answered, failed;
            locsnn_bytes #(
                .AXONS(AXONS), .SYNAPSES(SYNAPSES), .COMPARTMENTS(COMPARTMENTS), .SLOTS(SLOTS),
                .CHARGE(CHARGE), .JOIN(JOIN), .BITMAP(BITMAP), .VISITS(VISITS), .ENTRIES(ENTRIES), .WORD(WORD),
                .PHASE_WORDS(PHASE_WORDS), .ONE_PORT(ONE_PORT), .LATER(LATER), .GROUPS(GROUPS), .BUFFER(BUFFER), .SPIKES(SPIKES)
            ) board (
                .clk, .reset(reset || button), .in_valid(pass), .in_data(passed), .in_broken(pass_broken),
                .out_valid(heard_valid), .out_ready(1'b1), .out_data(heard), .loaded, .running, .answered, .failed
            );
        end
    endgenerate
    always #5 clk = !clk;

    integer waited, token, place;
    logic   came = 0;  // a byte has come since the last dot
    always @(posedge clk) begin
        reset <= 0;
        if (heard_valid && !reset) begin
            $fwrite(STDOUT, "%0d\n", heard);
            came = 1;
        end
    end

    // Send a byte over the line: a start bit, 8 bits, the lowest first, and a stop bit of the given level.
    task automatic send(input [7:0] value, input stop);
        to_board = 0;
        repeat (HOST_BIT) @(negedge clk);
        for (place = 0; place < 8; place = place + 1) begin
            to_board = value[place];
            repeat (HOST_BIT) @(negedge clk);
        end
        to_board = stop;
        repeat (HOST_BIT) @(negedge clk);
        to_board = 1;
        if (!stop) repeat (HOST_BIT) @(negedge clk);  // idle, so that the next start bit has a falling edge
    endtask

    initial begin
        repeat (80) @(negedge clk);  // longer than the 32 cycles that reset_sync.sv holds the reset
        while ($fscanf(STDIN, "%d", token) == 1) begin
            if (token < 512 && BIT != 0) send(token[7:0], !token[8]);
            else if (token < 512) begin
                {passed, pass, pass_broken} = {token[7:0], !token[8], token[8]};
                @(negedge clk);
                {pass, pass_broken} = 0;
            end else if (token == 512) begin
                waited = 0;
                while (!came && waited < PATIENCE) begin
                    @(negedge clk);
                    waited = waited + 1;
                end
                came = 0;
                $fwrite(STDOUT, ".\n");
                $fflush(STDOUT);
            end else begin
                button = 1;
                repeat (8) @(negedge clk);  // longer than the button's synchroniser takes
                button = 0;
                repeat (80) @(negedge clk);
            end
        end
        $finish;
    end
endmodule
