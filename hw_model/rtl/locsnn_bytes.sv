// The core behind a protocol of bytes, which a UART or anything else may carry. The host's bytes are requests, and the
// board's bytes are replies; docs/reference/hardware/serial-line-and-axi.md describes both.
//
//     bytes -> frame_receiver -> commands -> load port, stream -> locsnn_core
//     bytes <- frame_sender   <- replies  <- answer, spike_report <----'
module locsnn_bytes #(
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
    parameter integer BUFFER = 256,  // bytes of frames that wait; a power of two, and at least 64
    parameter integer SPIKES = 256   // spikes that wait for the host; a power of two
) (
    input  logic       clk,
    input  logic       reset,
    input  logic       in_valid,
    input  logic [7:0] in_data,
    input  logic       in_broken,    // a byte was lost on the line
    output logic       out_valid,
    input  logic       out_ready,
    output logic [7:0] out_data,
    output logic       loaded,
    output logic       running,
    output logic       answered,     // in one cycle per answer
    output logic       failed        // in one cycle per error of the protocol or of a recording
);
    wire         frame_valid, frame_ready, frame_last, error_valid;
    wire [7:0]   frame_data, error, expected;
    frame_receiver #(.BUFFER(BUFFER)) receiver (
        .clk, .reset, .byte_valid(in_valid), .byte_data(in_data), .byte_broken(in_broken),
        .frame_valid, .frame_ready, .frame_data, .frame_last, .error_valid, .error, .expected
    );

    // A register in between, for the clock: the receiver's memory answers late in a cycle, and commands has long paths.
    wire         heard_valid, heard_ready, heard_last;
    wire [7:0]   heard_data;
    one_word #(.WIDTH(9)) heard (
        .clk, .reset, .in_valid(frame_valid), .in_ready(frame_ready), .in_data({frame_last, frame_data}),
        .out_valid(heard_valid), .out_ready(heard_ready), .out_data({heard_last, heard_data})
    );

    wire         load_valid, word_valid, word_ready;
    wire [2:0]   load_memory;
    wire [23:0]  load_address;
    wire [127:0] load_data;
    wire [1:0]   word_kind;
    wire [15:0]  word_channel;
    wire         reply_valid, reply_ready, reply_hello, report;
    wire [7:0]   reply_error, reply_number;
    commands #(
        .AXONS(AXONS), .SYNAPSES(SYNAPSES), .COMPARTMENTS(COMPARTMENTS), .VISITS(VISITS), .PHASES(PHASE_WORDS)
    ) carry_out (
        .clk, .reset, .frame_valid(heard_valid), .frame_ready(heard_ready), .frame_data(heard_data), .frame_last(heard_last),
        .load_valid, .load_memory, .load_address, .load_data, .word_valid, .word_ready, .word_kind, .word_channel,
        .answered, .reply_valid, .reply_ready, .reply_hello, .reply_error, .reply_number, .report, .loaded, .running
    );

    wire         answer_valid, answer_ready, update, fired, spikes_wait;
    wire [2:0]   answer_error;
    wire [15:0]  answer_class;
    wire [31:0]  synapses, updates, active_updates, spikes, charge_wraps, current_wraps, voltage_clips;
    locsnn_core #(
        .AXONS(AXONS), .SYNAPSES(SYNAPSES), .COMPARTMENTS(COMPARTMENTS), .SLOTS(SLOTS), .CHARGE(CHARGE), .JOIN(JOIN), .BITMAP(BITMAP),
        .VISITS(VISITS), .ENTRIES(ENTRIES), .WORD(WORD), .PHASE_WORDS(PHASE_WORDS), .ONE_PORT(ONE_PORT), .LATER(LATER), .GROUPS(GROUPS)
    ) core (
        .clk, .reset, .load_valid, .load_memory, .load_address, .load_data,
        .in_valid(word_valid), .in_ready(word_ready), .in_kind(word_kind), .in_channel(word_channel), .hold(spikes_wait),
        .answer_valid, .answer_ready, .answer_error, .answer_class,
        .answer_synapses(synapses), .answer_updates(updates), .answer_active_updates(active_updates),
        .answer_spikes(spikes), .answer_charge_wraps(charge_wraps), .answer_current_wraps(current_wraps),
        .answer_voltage_clips(voltage_clips),
        /* verilator lint_off PINCONNECTEMPTY */
        .probe_valid(update), .probe_compartment(), .probe_u(), .probe_v(), .probe_potential(), .probe_fired(fired),
        .probe_active(), .probe_charge_wrap(), .probe_current_wraps(), .probe_voltage_clip(),
        .probe_score_valid(), .probe_score()
        /* verilator lint_on PINCONNECTEMPTY */
    );

    wire [15:0] winner = answer_error == 0 ? answer_class : 16'b0;  // after an error the class is an old one

    // Cycles from the first word of a recording to its answer, a slow host included.
    logic [31:0] cycles;
    always_ff @(posedge clk) begin
        if (!running) cycles <= 0;
        else if (!answer_valid) cycles <= cycles + 1;
    end

    wire         spike_valid, spike_ready, spike_more;
    wire [23:0]  spike, lost;
    spike_report #(.DEPTH(SPIKES)) reporter (
        .clk, .reset, .wanted(report), .running, .update, .fired,
        .head_valid(spike_valid), .head(spike), .more(spike_more), .pop(spike_ready), .lost,
        .crowded(spikes_wait)
    );

    wire         reply_frame_valid, reply_frame_ready, reply_frame_last;
    wire [7:0]   reply_frame_data;
    // The parameters as a host reads them (hw_model/rtl/board.py): eleven numbers of three bytes, the last one shared by three.
    localparam logic [263:0] SIZE = {24'(AXONS), 24'(SYNAPSES), 24'(COMPARTMENTS), 24'(SLOTS), 24'(CHARGE), 24'(JOIN),
                                     24'(BITMAP), 24'(VISITS), 24'(ENTRIES), 24'(WORD), 1'(GROUPS), 3'(LATER), 20'(PHASE_WORDS)};
    replies #(.BUFFER(BUFFER), .SIZES(11), .SIZE(SIZE)) reply (
        .clk, .reset, .error_valid, .error, .expected,
        .reply_valid, .reply_ready, .reply_hello, .reply_error, .reply_number, .loaded,
        .spike_valid, .spike_ready, .spike, .spike_more, .answer_valid, .answer_ready,
        .answer({5'b0, answer_error, winner, cycles, synapses, updates, active_updates, spikes, charge_wraps, current_wraps,
                 voltage_clips, lost}),
        .frame_valid(reply_frame_valid), .frame_ready(reply_frame_ready), .frame_data(reply_frame_data),
        .frame_last(reply_frame_last)
    );

    // A register in between, for the clock: memories answer late in a cycle, and the choice of a byte among 40 is slow.
    wire         said_valid, said_ready, said_last;
    wire [7:0]   said_data;
    one_word #(.WIDTH(9)) said (
        .clk, .reset, .in_valid(reply_frame_valid), .in_ready(reply_frame_ready),
        .in_data({reply_frame_last, reply_frame_data}),
        .out_valid(said_valid), .out_ready(said_ready), .out_data({said_last, said_data})
    );
    frame_sender sender (
        .clk, .reset, .frame_valid(said_valid), .frame_ready(said_ready), .frame_data(said_data), .frame_last(said_last),
        .byte_valid(out_valid), .byte_ready(out_ready), .byte_data(out_data)
    );

    assign answered = answer_valid && answer_ready;
    assign failed = error_valid || (reply_ready && reply_error != 0) || (answered && answer_error != 0);
endmodule
