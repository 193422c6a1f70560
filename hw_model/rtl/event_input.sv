// The stream of a recording, checked. In comes an event per spike, in ascending order of channels within a step, a tick after
// each step, and an end. Out go words of the same kinds for the sequencer of locsnn_core.sv, with silent steps (ticks without
// events) added before the end until the recording has as many steps as the program expects. A word that is accepted in one
// cycle is offered from the next; the next word is accepted at the earliest in the cycle after it was taken.
//
// An event on a channel that does not exist, one that does not ascend (so the same one twice), a step too many and an end
// before the tick of its step are errors: what follows is dropped up to the end, and the recording is answered with the
// error's number. A stop drops the recording without an answer.
//
// A source is whatever sends spikes: a channel, a row of a visit (transpose.sv) or a compartment. Channels are the sources from
// 0 on, so the number of a channel is that of its source. The mark outputs tell transpose.sv, which buffers the recording for
// later phases, what was accepted.
module event_input #(
    parameter integer SOURCE = 11  // bits of the number of a source; locsnn_core.sv sets it, here for its default of 2,048
) (
    input  logic              clk,
    input  logic              clear,      // forget the recording, and wait for the next
    input  logic              listen,     // words may be accepted: the first phase is running
    input  logic [23:0]       steps,      // of the first phase; 0: as many as the recording has
    input  logic [23:0]       channels,   // at most 2^SOURCE, and 2^16 in any case; a setting of 24 bits like all others
    input  logic              in_valid,
    output logic              in_ready,
    input  logic [1:0]        in_kind,    // 0 event, 1 tick, 2 end, 3 stop
    input  logic [15:0]       in_channel,
    output logic              out_valid,
    input  logic              out_ready,
    output logic [1:0]        out_kind,
    output logic [SOURCE-1:0] out_source,  // also the channel of the last event, to see whether the next one ascends
    output logic              mark,       // an event of `out_source` was accepted in the cycle before
    output logic              mark_tick,  // a tick was accepted in the cycle before, or a silent step began
    output logic              stop,       // a stop was accepted in the cycle before
    output logic              failed,     // the end of a recording with an error was accepted in the cycle before
    output logic [2:0]        error       // of this recording, the first one; 0: none
);
    localparam logic [1:0] EVENT = 0, TICK = 1, END = 2, STOP = 3;
    localparam logic [2:0] NO_CHANNEL = 1, NOT_ASCENDING = 2, TOO_LONG = 3, NO_TICK = 4, NO_STEP = 5;  // NO_STEP: no step at all

    logic        tail;   // the end came; silent steps follow
    logic        ended;  // the last word was given out
    logic        open;   // an event came since the last tick
    logic [23:0] step;   // steps so far, silent ones included
    wire         free = !out_valid;  // a word that is taken in this cycle is known too late to accept the next one in it
    wire         full = steps != 0 && step == steps;  // the recording has all steps of the program
    wire         accepted = in_valid && in_ready;
    assign in_ready = listen && !tail && !ended && free;

    logic [2:0] problem;  // with the word that is offered; 0: none
    always_comb begin
        problem = 0;
        // The whole channel is compared, so the upper bits that `out_source` leaves out below are 0. 17 bits hold 2^16 channels.
        if (in_kind == EVENT && {1'b0, in_channel} >= channels[16:0]) problem = NO_CHANNEL;
        else if (in_kind == EVENT && open && !(out_source < in_channel[SOURCE-1:0])) problem = NOT_ASCENDING;
        else if ((in_kind == EVENT || in_kind == TICK) && full) problem = TOO_LONG;
        else if (in_kind == END && open) problem = NO_TICK;
        else if (in_kind == END && step == 0 && steps == 0) problem = NO_STEP;
    end
    wire sound = error == 0 && problem == 0;

    // The clock runs in all cycles in which a register below may change: for a clear, a word accepted, a pulse that ends after
    // its one cycle, a word taken, and silent steps.
    wire ticking;
    clock_gate gate (
        .clk, .enable(clear || accepted || mark || mark_tick || stop || failed || out_ready || (tail && free)), .gated(ticking)
    );
    always_ff @(posedge ticking) begin
        mark <= accepted && in_kind == EVENT && sound;
        mark_tick <= accepted ? in_kind == TICK && sound : tail && free && steps != 0 && !full;
        stop <= accepted && in_kind == STOP;
        failed <= accepted && in_kind == END && !sound;
        if (accepted) begin
            if (error == 0) error <= problem;
            open <= in_kind == EVENT;
            out_kind <= in_kind;
            out_source <= in_channel[SOURCE-1:0];
            out_valid <= sound && (in_kind == EVENT || in_kind == TICK);
            if (in_kind == TICK) step <= step + 1;
            if (in_kind == END && sound) tail <= 1;
            if (in_kind == STOP || (in_kind == END && !sound)) ended <= 1;
        end else if (tail && free) begin
            out_valid <= 1;
            out_kind <= steps == 0 || full ? END : TICK;
            step <= step + 1;
            if (steps == 0 || full) {tail, ended} <= 2'b01;
        end else if (out_ready) out_valid <= 0;
        if (clear) {out_valid, tail, ended, open, step, error} <= 0;
    end

    wire unused_settings = &{1'b0, channels};
    generate
        if (SOURCE < 16) wire unused = &{1'b0, in_channel[15:SOURCE]};
    endgenerate
endmodule
