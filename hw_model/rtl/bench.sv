// Test bench of the core: fills its memories, streams recordings in as a host that is always ready, and writes down every
// update, score and answer. hw_model/rtl/cosimulation.py writes and reads its files, which lie in the working folder:
//
//     load      a load word per line: memory, address, data, in hexadecimal digits (2, 6, 32)
//     words     a word of the stream per line, in hexadecimal digits: its kind times 2^16 and its channel
//     updates   a line per update: compartment, u, v, potential, fired, active, wraps of charge and current, clips
//     scores    a line per recording: the score of every class
//     answers   a line per recording: error, class, cycles, then its counts in the order of the core's ports
//
// What is written is decimal; unknown bits of an update's registers count as 0. The run ends with the last answer, or after
// `patience` cycles (+patience=N, 2^20 unless given) in which nothing happened.
`timescale 1ns / 1ps
module bench #(
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
    parameter integer STEP = 0,
    parameter integer PLACES = 0,
    parameter integer SUMS = 0,
    parameter integer ONE_PORT = 0,
    parameter integer LATER = 0,
    parameter integer GROUPS = 0
) ();
    logic         clk = 0, reset = 1;
    logic         load_valid = 0;
    logic [7:0]   load_memory = 0;
    logic [23:0]  load_address = 0;
    logic [127:0] load_data = 0;
    logic         in_valid = 0;
    wire          in_ready;
    logic [31:0]  word = 0, next_word;
    wire          answer_valid;
    wire [2:0]    error;
    wire [15:0]   winner;
    wire [31:0]   synapses, updates, active_updates, spikes, charge_wraps, current_wraps, voltage_clips;
    wire          done, fired, active, charge_wrap, voltage_clip, score_valid;
    wire [$clog2(COMPARTMENTS)-1:0] compartment;
    wire [23:0]   u, v, potential;
    wire [1:0]    current_wrap;
    wire [63:0]   score;

    locsnn_core #(
        .AXONS(AXONS), .SYNAPSES(SYNAPSES), .COMPARTMENTS(COMPARTMENTS), .SLOTS(SLOTS), .CHARGE(CHARGE), .JOIN(JOIN),
        .BITMAP(BITMAP), .VISITS(VISITS), .ENTRIES(ENTRIES), .WORD(WORD), .PHASE_WORDS(PHASE_WORDS),
        .STEP(STEP), .PLACES(PLACES), .SUMS(SUMS), .ONE_PORT(ONE_PORT), .LATER(LATER), .GROUPS(GROUPS)
    ) core (
        .clk, .reset, .load_valid, .load_memory(load_memory[2:0]), .load_address, .load_data,
        .in_valid, .in_ready, .in_kind(word[17:16]), .in_channel(word[15:0]), .hold(1'b0),
        .answer_valid, .answer_ready(1'b1), .answer_error(error), .answer_class(winner),
        .answer_synapses(synapses), .answer_updates(updates), .answer_active_updates(active_updates),
        .answer_spikes(spikes), .answer_charge_wraps(charge_wraps), .answer_current_wraps(current_wraps),
        .answer_voltage_clips(voltage_clips),
        .probe_valid(done), .probe_compartment(compartment), .probe_u(u), .probe_v(v), .probe_potential(potential),
        .probe_fired(fired), .probe_active(active), .probe_charge_wrap(charge_wrap),
        .probe_current_wraps(current_wrap), .probe_voltage_clip(voltage_clip),
        .probe_score_valid(score_valid), .probe_score(score)
    );

    always #5 clk = !clk;

    integer       load_file, words_file, updates_file, scores_file, answers_file;
    int           update_u, update_v, update_potential;  // of two states: a bit is never unknown
    logic [159:0] load_word;
    logic         more = 1;  // words to come
    logic [63:0]  cycle = 0, first_cycle = 0;
    logic         begun = 0;  // the first word of a recording was accepted, in `first_cycle`
    logic [31:0]  owed = 0;  // recordings whose last word was accepted and that are not answered
    integer       idle = 0, patience = 1 << 20;  // cycles in which nothing happened, and how many there may be

    initial begin
        load_file = $fopen("load", "r");
        words_file = $fopen("words", "r");
        updates_file = $fopen("updates", "w");
        scores_file = $fopen("scores", "w");
        answers_file = $fopen("answers", "w");
        if (!$value$plusargs("patience=%d", patience)) patience = 1 << 20;
        repeat (4) @(negedge clk);
        reset = 0;
        while ($fscanf(load_file, "%h", load_word) == 1) begin
            load_valid = 1;
            {load_memory, load_address, load_data} = load_word;
            @(negedge clk);
        end
        load_valid = 0;
        while ($fscanf(words_file, "%h", next_word) == 1) begin
            in_valid = 1;
            word = next_word;
            while (!in_ready) @(negedge clk);
            @(negedge clk);
        end
        in_valid = 0;
        more = 0;
    end

    // What happens in a cycle is written down at its end, the rising edge. The inputs of the core change at the falling edge.
    wire last_word = in_valid && in_ready && word[17];  // an end (kind 2) or a stop (3)
    always @(posedge clk) begin
        cycle <= cycle + 1;
        if (in_valid && in_ready && !begun) begin
            begun <= 1;
            first_cycle <= cycle;
        end
        if (in_valid && in_ready && word[17:16] == 3) begun <= 0;  // a stop drops the recording
        if (done) begin
            update_u = $signed(u);
            update_v = $signed(v);
            update_potential = $signed(potential);
            $fwrite(updates_file, "%0d %0d %0d %0d %b %b %b %0d %b\n", compartment, update_u, update_v, update_potential,
                    fired, active, charge_wrap, current_wrap, voltage_clip);
        end
        if (score_valid) $fwrite(scores_file, "%0d ", $signed(score));
        if (answer_valid) begin
            begun <= 0;
            $fwrite(scores_file, "\n");
            $fwrite(answers_file, "%0d %0d %0d %0d %0d %0d %0d %0d %0d %0d\n", error, winner, cycle - first_cycle,
                    synapses, updates, active_updates, spikes, charge_wraps, current_wraps, voltage_clips);
        end
        // An end is owed an answer, a stop is not. Before the reset it is unknown whether there is an answer.
        owed <= reset ? 0 : owed + {31'b0, last_word && word[16] == 0} - {31'b0, answer_valid};
        // `===`, so that an unknown signal does not count as a sign of life.
        idle <= (load_valid || done || answer_valid || (in_valid && in_ready)) === 1'b1 ? 0 : idle + 1;
        if ((!more && !in_valid && owed == 0) || idle == patience) begin
            $fclose(updates_file);
            $fclose(scores_file);
            $fclose(answers_file);
            $finish;
        end
    end
endmodule
