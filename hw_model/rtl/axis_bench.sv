// Test bench of locsnn_axis: plays recordings through its AXI-Streams, on which both sides stall at random, and checks that
// what is offered stays until it is taken. It reads and writes files in the working folder:
//
//     load      a beat of s_load per line, in hexadecimal digits
//     words     a beat of s_axis per line: TLAST times 2^32 and its data, in hexadecimal digits
//     answers   a line per packet of m_axis; "moved" in it where an offered beat changed before it was taken
//     spikes    a line per beat of m_spikes
//
// The run ends after `patience` cycles (+patience=N, 65,536 unless given) in which no stream has moved.
`timescale 1ns / 1ps
module axis_bench #(
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
    parameter integer SPIKES = 256,
    parameter integer WAITS = 2  // in how many of four cycles each side stalls, on average: 0 to 3
) ();
    logic         clk = 0, aresetn = 0;
    logic         s_load_tvalid = 0, s_axis_tvalid = 0, s_axis_tlast = 0, m_axis_tready = 0, m_spikes_tready = 0;
    wire          s_load_tready, s_axis_tready, m_axis_tvalid, m_axis_tlast, m_spikes_tvalid;
    logic [159:0] s_load_tdata = 0;
    logic [31:0]  s_axis_tdata = 0;
    wire  [31:0]  m_axis_tdata, m_spikes_tdata;

    locsnn_axis #(
        .AXONS(AXONS), .SYNAPSES(SYNAPSES), .COMPARTMENTS(COMPARTMENTS), .SLOTS(SLOTS), .CHARGE(CHARGE), .JOIN(JOIN),
        .BITMAP(BITMAP), .VISITS(VISITS), .ENTRIES(ENTRIES), .WORD(WORD), .PHASE_WORDS(PHASE_WORDS),
        .LATER(LATER), .GROUPS(GROUPS), .SPIKES(SPIKES)
    ) dut (
        .aclk(clk), .aresetn, .report(1'b1), .s_load_tvalid, .s_load_tready, .s_load_tdata,
        .s_axis_tvalid, .s_axis_tready, .s_axis_tdata, .s_axis_tlast,
        .m_axis_tvalid, .m_axis_tready, .m_axis_tdata, .m_axis_tlast, .m_spikes_tvalid, .m_spikes_tready, .m_spikes_tdata
    );
    always #5 clk = !clk;

    integer       load_file, words_file, answers_file, spikes_file, idle = 0, patience = 1 << 16;
    logic [159:0] next_load;
    logic [32:0]  next_word;
    logic [31:0]  random = 32'h12345678;  // a linear-feedback shift register of 32 bits
    wire          wait_word = random[1:0] < WAITS;

    initial begin
        load_file = $fopen("load", "r");
        words_file = $fopen("words", "r");
        answers_file = $fopen("answers", "w");
        spikes_file = $fopen("spikes", "w");
        if (!$value$plusargs("patience=%d", patience)) patience = 1 << 16;
        repeat (4) @(negedge clk);
        aresetn = 1;
        repeat (2) @(negedge clk);
        while ($fscanf(load_file, "%h", next_load) == 1) begin
            {s_load_tvalid, s_load_tdata} = {1'b1, next_load};
            while (!s_load_tready) @(negedge clk);
            @(negedge clk);
        end
        s_load_tvalid = 0;
        while ($fscanf(words_file, "%h", next_word) == 1) begin
            while (wait_word) @(negedge clk);
            {s_axis_tvalid, s_axis_tlast, s_axis_tdata} = {1'b1, next_word};
            #1;
            while (!s_axis_tready) @(negedge clk);
            @(negedge clk);
            s_axis_tvalid = 0;
        end
    end

    // Both sides drive at the falling edge, and the streams are observed at the rising edge. The taps (32, 22, 2, 1) give the
    // random register its full period. Each stream that stalls looks at two bits of its own.
    always @(negedge clk) begin
        random <= {random[30:0], random[31] ^ random[21] ^ random[1] ^ random[0]};
        m_axis_tready <= random[3:2] >= WAITS;
        m_spikes_tready <= random[5:4] >= WAITS;
    end
    logic        held = 0;     // a beat was offered in the cycle before and not taken: `offered` has to be there still
    logic [32:0] offered = 0;
    always @(posedge clk) begin
        held <= m_axis_tvalid && !m_axis_tready;
        offered <= {m_axis_tlast, m_axis_tdata};
        if (held && (!m_axis_tvalid || offered != {m_axis_tlast, m_axis_tdata})) $fwrite(answers_file, "moved ");
        if (m_axis_tvalid && m_axis_tready) $fwrite(answers_file, "%0d%s", m_axis_tdata, m_axis_tlast ? "\n" : " ");
        if (m_spikes_tvalid && m_spikes_tready) $fwrite(spikes_file, "%0d\n", m_spikes_tdata);
        idle <= (s_load_tvalid && s_load_tready) || (s_axis_tvalid && s_axis_tready) || m_axis_tvalid || m_spikes_tvalid ? 0
                : idle + 1;
        if (idle == patience) begin
            $fclose(answers_file);
            $fclose(spikes_file);
            $finish;
        end
    end
endmodule
