// Proof of event_input.sv against the contract of the stream, whatever host and core do: what is accepted leaves once, in order and
// unchanged; what is offered stays until it is taken; a word is accepted only where there is room for it; errors, marks,
// stops and silent steps are as docs/reference/hardware/stream-and-memory-map.md says. Settings are any, with as many
// channels as there are sources at most, and stay as they are.
//
// The model is a queue of one word, `held`: what was accepted, or is due at the end, and has not been taken. Yosys, when
// `flatten` dissolves the module, connects wires with the attribute hierconn to those of the module that have their names; only
// induction uses them.
module event_input_proof (
    input logic        clk,
    input logic        clear,
    input logic        listen,
    input logic        in_valid,
    input logic [1:0]  in_kind,
    input logic [15:0] in_channel,
    input logic        out_ready
);
    localparam logic [1:0] EVENT = 0, TICK = 1, END = 2, STOP = 3;
    (* anyconst *) logic [23:0] steps;
    (* anyconst *) logic [23:0] channels;
    wire        in_ready, out_valid, mark, mark_tick, stop, failed;
    wire [1:0]  out_kind;
    wire [9:0]  out_source;
    wire [2:0]  error;
    event_input #(.SOURCE(10)) dut (
        .clk, .clear, .listen, .steps, .channels, .in_valid, .in_ready, .in_kind, .in_channel,
        .out_valid, .out_ready, .out_kind, .out_source, .mark, .mark_tick, .stop, .failed, .error
    );

    // The model: what came of the recording so far.
    logic [23:0] ticks, given;         // ticks that were accepted, and that went out, silent ones included
    logic        in_step, over, gone;  // an event came since the last tick; an end or a stop came; nothing is to come
    logic [15:0] highest;              // channel of that event
    logic [2:0]  wrong;                // its first error
    logic        held;
    logic [1:0]  held_kind;
    logic [9:0]  held_source;

    wire accepted = in_valid && in_ready;
    wire taken = out_valid && out_ready;
    wire all_steps = steps != 0 && ticks == steps;
    wire [2:0] problem =
        in_kind == EVENT && in_channel >= channels ? 3'd1
        : in_kind == EVENT && in_step && in_channel <= highest ? 3'd2
        : !in_kind[1] && all_steps ? 3'd3
        : in_kind == END && in_step ? 3'd4
        : in_kind == END && steps == 0 && ticks == 0 ? 3'd5 : 3'd0;
    wire [2:0] verdict = wrong != 0 ? wrong : problem;
    wire       passed = accepted && verdict == 0;
    wire       closing = over && !gone;               // silent steps and the end
    wire       due = closing && !held;                // one of them comes next
    wire       last = steps == 0 || given == steps;

    logic        was_clear = 1, marked, ticked, stopped, ended_wrong;
    logic [9:0]  marked_channel;
    always_ff @(posedge clk) begin
        was_clear <= clear;
        marked <= passed && in_kind == EVENT;
        marked_channel <= in_channel[9:0];
        ticked <= accepted ? passed && in_kind == TICK : due && !last;
        stopped <= accepted && in_kind == STOP;
        ended_wrong <= accepted && in_kind == END && verdict != 0;
        if (taken) held <= 0;
        if (taken && out_kind == TICK) given <= given + 1;
        if (accepted) begin
            wrong <= verdict;
            in_step <= in_kind == EVENT;
            highest <= in_channel;
            if (in_kind == TICK) ticks <= ticks + 1;
            if (in_kind[1]) over <= 1;
            if (in_kind == STOP || (in_kind == END && verdict != 0)) gone <= 1;
            if (passed && !in_kind[1]) {held, held_kind, held_source} <= {1'b1, in_kind, in_channel[9:0]};
        end else if (due) begin
            {held, held_kind} <= {1'b1, last ? END : TICK};
            if (last) gone <= 1;
        end
        if (clear) {ticks, given, in_step, over, gone, wrong, held} <= 0;
    end

    (* hierconn *) wire        \dut.tail ;
    (* hierconn *) wire        \dut.ended ;
    (* hierconn *) wire        \dut.open ;
    (* hierconn *) wire [23:0] \dut.step ;

    logic begun = 0;  // after the first clear
    always_ff @(posedge clk) if (clear) begun <= 1;
    always_comb begin
        if (!begun) assume (clear);
        assume (channels <= 1024);
        if (begun) begin
            // Nothing is lost, doubled, changed or out of order: what is offered is what is held, from cycle to cycle.
            assert (out_valid == held);
            if (held) assert (out_kind == held_kind);
            if (held && held_kind == EVENT) assert (out_source == held_source);
            // A word is accepted where it is listened to, where the recording goes on and where there is room.
            assert (in_ready == (listen && !over && !held));
            // As many ticks as the recording has to have are out when its end is.
            if (held && held_kind == END) assert (given == (steps == 0 ? ticks : steps));
            assert (error == wrong);
            if (!was_clear) begin
                assert (mark == marked);
                if (mark) assert (out_source == marked_channel);
                assert (mark_tick == ticked);
                assert (stop == stopped);
                assert (failed == ended_wrong);
            end
            // For induction: what the module remembers.
            assert ( \dut.tail == closing);
            assert ( \dut.ended == gone);
            assert ( \dut.open == (in_step && !over));
            if (in_step && wrong == 0) assert (out_source == highest);
            if (!over) assert ( \dut.step == ticks);
            if (closing) assert ( \dut.step == given + (held && held_kind == TICK));
            if (wrong == 0 && steps != 0) assert (ticks <= steps);
            if (wrong == 0 && !over) assert (given + (held && held_kind == TICK) == ticks);
            if (gone) assert (over);
            if (in_step) assert (!over || wrong != 0);
            if (closing) assert (wrong == 0 && (steps != 0 || !held));
            if (closing && steps != 0) assert (given + (held && held_kind == TICK) <= steps);
            if (held && held_kind == END) assert (gone && wrong == 0);
            if (held && !over) assert (!held_kind[1]);
            if (held) assert (held_kind != STOP);
        end
    end
endmodule
