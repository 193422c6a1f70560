// The core with AXI-Streams, for a processor or a DMA engine next to it.
//
//     s_load     memory (159:152), address (151:128), data (127:0); waits while a recording is under way
//     s_axis     kind (17:16) and channel (15:0): 0 event, 1 tick; TLAST comes with the last tick of a recording
//     m_axis     per recording: error (18:16) and class (15:0), seven counts, lost spikes; TLAST with the last beat
//     m_spikes   where `report` is high: a spike, as spike_report.sv numbers it; take them while the recording runs
//
// A recording's last beat may also be of kind 2, which is an end and nothing else, or 3, which drops the recording without an
// answer. Kinds 2 and 3 anywhere else, and bits above the kind, are answered with error 6 at the end of their recording.
module locsnn_axis #(
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
    parameter integer LATER = 0,
    parameter integer GROUPS = 0,
    parameter integer SPIKES = 256  // spikes that wait; a power of two
) (
    input  logic         aclk,
    input  logic         aresetn,
    input  logic         report,
    input  logic         s_load_tvalid,
    output logic         s_load_tready,
    input  logic [159:0] s_load_tdata,
    input  logic         s_axis_tvalid,
    output logic         s_axis_tready,
    input  logic [31:0]  s_axis_tdata,
    input  logic         s_axis_tlast,
    output logic         m_axis_tvalid,
    input  logic         m_axis_tready,
    output logic [31:0]  m_axis_tdata,
    output logic         m_axis_tlast,
    output logic         m_spikes_tvalid,
    input  logic         m_spikes_tready,
    output logic [31:0]  m_spikes_tdata
);
    localparam logic [1:0] END = 2;
    localparam logic [2:0] NO_WORD = 6;  // an error of this module; 1 to 5 are those of event_input.sv
    localparam logic [3:0] LAST = 8;  // the last of the nine beats of an answer, from 0

    logic       reset;
    always_ff @(posedge aclk) reset <= !aresetn;

    // Words: those of the stream, and an end after the last one.
    logic       closing;  // the last beat came: an end has to follow it into the core
    logic       wrong;    // a beat of this recording was not a valid word
    logic       open;     // words of a recording came
    logic       awaited;  // its answer is to come
    wire        bad = s_axis_tdata[31:18] != 0 || (s_axis_tdata[17] && !s_axis_tlast);
    wire        beat = s_axis_tvalid && s_axis_tready;
    wire        answered = m_axis_tvalid && m_axis_tready && m_axis_tlast;
    wire        in_ready;
    wire        in_valid = closing || (s_axis_tvalid && !bad);
    wire [1:0]  in_kind = closing ? END : s_axis_tdata[17:16];
    wire        in_taken = in_valid && in_ready;
    assign s_axis_tready = in_ready && !closing;
    assign s_load_tready = !open && !awaited;

    always_ff @(posedge aclk) begin
        if (beat) begin
            open <= 1;
            if (bad) wrong <= 1;
            if (s_axis_tlast) closing <= 1;
        end
        // The end that was added, or an end or a stop that came as the last beat: the recording is over for the core.
        if (in_taken && in_kind[1]) begin
            open <= 0;
            awaited <= in_kind == END;
            closing <= 0;
            if (in_kind != END) wrong <= 0;
        end
        if (answered) {awaited, wrong} <= 0;
        if (reset) {closing, wrong, open, awaited} <= 0;
    end

    wire         answer_valid, update, fired, spikes_wait;
    wire [2:0]   error;
    wire [15:0]  winner;
    wire [31:0]  synapses, updates, active_updates, spikes, charge_wraps, current_wraps, voltage_clips;
    locsnn_core #(
        .AXONS(AXONS), .SYNAPSES(SYNAPSES), .COMPARTMENTS(COMPARTMENTS), .SLOTS(SLOTS), .CHARGE(CHARGE), .JOIN(JOIN),
        .BITMAP(BITMAP), .VISITS(VISITS), .ENTRIES(ENTRIES), .WORD(WORD), .PHASE_WORDS(PHASE_WORDS), .LATER(LATER), .GROUPS(GROUPS)
    ) core (
        .clk(aclk), .reset, .load_valid(s_load_tvalid && s_load_tready), .load_memory(s_load_tdata[154:152]),
        .load_address(s_load_tdata[151:128]), .load_data(s_load_tdata[127:0]),
        .in_valid, .in_ready, .in_kind, .in_channel(s_axis_tdata[15:0]), .hold(spikes_wait),
        .answer_valid, .answer_ready(answered), .answer_error(error), .answer_class(winner),
        .answer_synapses(synapses), .answer_updates(updates), .answer_active_updates(active_updates),
        .answer_spikes(spikes), .answer_charge_wraps(charge_wraps), .answer_current_wraps(current_wraps),
        .answer_voltage_clips(voltage_clips),
        /* verilator lint_off PINCONNECTEMPTY */
        .probe_valid(update), .probe_compartment(), .probe_u(), .probe_v(), .probe_potential(), .probe_fired(fired),
        .probe_active(), .probe_charge_wrap(), .probe_current_wraps(), .probe_voltage_clip(),
        .probe_score_valid(), .probe_score()
        /* verilator lint_on PINCONNECTEMPTY */
    );

    // Answers, a count per beat, the first one highest in `answer`.
    wire  [23:0]  lost;
    logic [3:0]   index;
    wire  [2:0]   number = wrong ? NO_WORD : error;
    wire  [287:0] answer = {13'b0, number, number == 0 ? winner : 16'b0, synapses, updates, active_updates, spikes,
                            charge_wraps, current_wraps, voltage_clips, 8'b0, lost};
    wire  [8:0]   low = {LAST - index, 5'b0};
    assign m_axis_tvalid = answer_valid;
    assign m_axis_tdata = answer[low+:32];
    assign m_axis_tlast = index == LAST;
    always_ff @(posedge aclk) begin
        if (m_axis_tvalid && m_axis_tready) index <= m_axis_tlast ? 0 : index + 1;
        if (reset) index <= 0;
    end

    wire        spike_valid, more;
    wire [23:0] spike;
    assign m_spikes_tvalid = spike_valid;
    assign m_spikes_tdata = {8'b0, spike};
    spike_report #(.DEPTH(SPIKES)) reporter (
        .clk(aclk), .reset, .wanted(report), .running(open || awaited), .update, .fired,
        .head_valid(spike_valid), .head(spike), .more, .pop(spike_valid && m_spikes_tready), .lost,
        .crowded(spikes_wait)
    );

    wire unused = &{1'b0, s_load_tdata[159:155], more};
endmodule
